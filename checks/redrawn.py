"""Pictures of the pages drawn again by the code as it is, and compared with those stored.

A picture whose share of changed pixels is above the tolerance is older than the code that draws it.
``--write`` puts such a picture in its place: look at it first, where ``--output`` keeps it.
"""

from __future__ import annotations

import argparse
import csv
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[1]
STORED = {
    path.stem: path
    for page in ("docs", "study", "benchmarks")
    for path in (ROOT / page / "images").glob("*.png")
}
COMMAND = f"{shlex.quote(sys.executable)} -m vibrosweep"
WIDTH = 200  # pixels to which pictures are reduced, so that neither dots nor the few colours count
STEP = 40  # of 255: a pixel that differs by less in each colour is the same
# Share of changed pixels above which a picture is stale: two words of a legend are 0.003 of them,
# and fewer colours change less than 0.0001
TOLERANCE = 0.001
DPI = 200


@dataclass(frozen=True)
class Recipe:
    """How a picture is made."""

    lines: str  # of a shell, in an empty folder; {ROOT} is the repository
    file: str  # that they write


def figure(sweep: str, name: str) -> Recipe:
    """A figure of the command ``vibrosweep figures``."""
    run = f"vibrosweep run {{ROOT}}/sweeps/{sweep}.toml -o {sweep}.h5"
    return Recipe(f"{run} && vibrosweep figures {sweep}.h5 -o {sweep}", f"{sweep}/{name}.png")


def command(name: str, sweep: str, options: str = "") -> Recipe:
    """The picture of a command that draws its own."""
    return Recipe(
        f"vibrosweep {name} {{ROOT}}/sweeps/{sweep}.toml -o {sweep}.h5 {options}", f"{sweep}.png"
    )


def block(picture: str) -> Recipe:
    """The picture that the Python lines of its card in the gallery draw."""
    return Recipe(f"python {{ROOT}}/checks/redrawn.py --card {picture}", f"{picture}.png")


def stored(picture: str) -> Recipe:
    """A picture of times, which is drawn from their stored table."""
    return Recipe(f"python {{ROOT}}/checks/redrawn.py --stored {picture}", f"{picture}.png")


def campaign(line: str, file: str) -> Recipe:
    return Recipe(f"python {{ROOT}}/checks/{line}", f"{file}.png")


NOISE = ["noise_lifetime", "noise_windows", "noise_energy", "noise_staggering"]
RECIPES: dict[str, Recipe] = {
    "height_time": figure("single_ball", "fig1_height_time"),
    "moving_height_time_all": block("moving_height_time_all"),
    "two_tones": figure("two_tones", "fig1_height_time"),
    "return_map": figure("return_map", "fig4_return_map"),
    "spectrum": block("spectrum"),
    "separation_distribution": figure("separations", "separation_distribution"),
    "locked_plane": block("locked_plane"),
    "parameter_plane": figure("paper", "parameter_plane"),
    "windows": command("windows", "windows"),
    "bifurcation": command("bifurcation", "bifurcation"),
    "basins": command("basins", "basins"),
    "basin_shares": command("basins", "basin_shares"),
    "orbits": command("orbits", "orbits", "--impacts 2 --periods 3"),
    "orbit_branches": command("branches", "branches", "--impacts 2 --doublings 4"),
    "orbit_boundaries": command("boundaries", "boundaries", "--impacts 2"),
    **{name: campaign("noise.py --pictures .", name) for name in NOISE},
    "high_bounce_plane": campaign(
        "high_bounce_cost.py --only plane --pictures .", "high_bounce_plane"
    ),
    "inelastic_staircase": campaign(
        "high_bounce_cost.py --only literature --pictures .", "inelastic_staircase"
    ),
    "high_bounce_limit": campaign(
        "high_bounce_cost.py --only limit --pictures .", "high_bounce_limit"
    ),
    **{
        f"ordering_{part}": campaign(f"ordering.py --only {part} --pictures .", f"ordering_{part}")
        for part in ("phases", "stability", "attractors")
    },
    "laboratory_track": campaign("laboratory.py cases --figures .", "laboratory_track_locked"),
    "laboratory_two_tones": campaign("laboratory.py cases --figures .", "laboratory_two_tones"),
    "laboratory_table4": campaign(
        "laboratory.py cases --figures .", "laboratory_table4_sign_change"
    ),
    "laboratory_imperfections": campaign(
        "laboratory.py imperfections --duration 8 --figures .", "laboratory_imperfections"
    ),
    **{name: stored(name) for name in ("cost", "peers", "work_precision")},
}


def draw_card(picture: str) -> None:
    """Run the Python lines of a card of the gallery, and save the last figure."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    card = page.partition(f"](images/{picture}.png)")[2].partition("\n![")[0]
    lines = re.search(r"```\{testcode\}\n(.*?)```", card, re.DOTALL)[1]
    exec(compile(lines, picture, "exec"), {})
    plt.gcf().savefig(f"{picture}.png", dpi=DPI)


def draw_stored(picture: str) -> None:
    """Draw a picture of times from their table."""
    sys.path.append(str(ROOT / "benchmarks"))
    with (ROOT / "benchmarks" / f"{picture}.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    path = Path(f"{picture}.png")
    if picture == "cost":
        import cost

        numbers = ({k: v if k == "line" else float(v) for k, v in row.items()} for row in rows)
        cost.draw([cost.Point(**row) for row in numbers], path)
    elif picture == "peers":
        from methods import peers_report

        peers_report.draw(rows, path)
    else:
        import methods.figure
        import work_precision

        methods.figure.draw(rows, work_precision.SCENES, path)


@cache
def cooked(lines: str, output: Path) -> None:
    """Run the lines of a recipe, once for all pictures that they draw."""
    text = lines.replace("{ROOT}", shlex.quote(str(ROOT)))
    text = re.sub(r"(?<![\w/.])python ", f"{shlex.quote(sys.executable)} ", text)
    text = re.sub(r"(?<![\w/.])vibrosweep ", f"{COMMAND} ", text)
    done = subprocess.run(["bash", "-ec", text], cwd=output, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{lines}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def reduced(path: Path) -> np.ndarray:
    image = Image.open(path).convert("RGBA")
    whole = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")
    height = round(WIDTH * image.height / image.width)
    return np.asarray(whole.resize((WIDTH, height), Image.Resampling.BOX), float)


def changed(old: Path, new: Path) -> float:
    """Share of the pixels that differ; 1 if the pictures have different proportions."""
    first, second = reduced(old), reduced(new)
    if abs(len(first) - len(second)) > 1:
        return 1.0
    rows = min(len(first), len(second))
    return float((np.abs(first[:rows] - second[:rows]).max(axis=2) > STEP).mean())


def write(drawn: Path, picture: str) -> None:
    """Store a picture as large as before, in few colours, which make it smaller."""
    path = STORED[picture]
    width = Image.open(path).width
    image = Image.open(drawn).convert("RGB")
    size = (width, round(width * image.height / image.width))
    if image.size != size:
        image = image.resize(size, Image.Resampling.LANCZOS)
    image.quantize(256).save(path, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("pictures", nargs="*", metavar="PICTURE", help="names; default: all")
    parser.add_argument("--output", type=Path, metavar="DIR", help="keep the pictures here")
    parser.add_argument("--write", action="store_true", help="replace those that are stale")
    parser.add_argument("--card", metavar="PICTURE", help="draw the card of the gallery, here")
    parser.add_argument("--stored", metavar="PICTURE", help="draw from a stored table, here")
    options = parser.parse_args()
    draws: list[tuple[str | None, Callable[[str], None]]]
    draws = [(options.card, draw_card), (options.stored, draw_stored)]
    for picture, draw in draws:
        if picture is not None:
            draw(picture)
            return
    if unknown := sorted({*options.pictures} - RECIPES.keys()):
        parser.error(f"{', '.join(unknown)}: no such picture; there are {', '.join(RECIPES)}")
    stale = []
    with tempfile.TemporaryDirectory() as folder:
        output = (options.output or Path(folder)).resolve()
        output.mkdir(parents=True, exist_ok=True)
        for picture in options.pictures or RECIPES:
            recipe = RECIPES[picture]
            cooked(recipe.lines, output)
            share = changed(STORED[picture], output / recipe.file)
            print(f"{picture:30} {100.0 * share:.2f} % of the pixels changed", flush=True)
            if share > TOLERANCE:
                stale.append(picture)
                if options.write:
                    write(output / recipe.file, picture)
    if stale:
        raise SystemExit(f"older than the code that draws them: {', '.join(stale)}")


if __name__ == "__main__":
    main()
