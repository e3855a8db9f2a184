"""The pictures of the pages have recipes, and an old one is told from a new one."""

from pathlib import Path

import pytest
from PIL import Image, ImageDraw

import redrawn

ROOT = Path(__file__).parents[1]


def test_every_picture_has_a_recipe():
    assert sorted(redrawn.RECIPES) == sorted(redrawn.STORED)


def test_recipes_name_files_that_exist():
    for recipe in redrawn.RECIPES.values():
        for word in recipe.lines.split():
            if word.startswith("{ROOT}"):
                assert Path(word.replace("{ROOT}", str(ROOT))).exists(), word


@pytest.mark.parametrize("picture", ["cost", "peers", "work_precision"])
def test_times_are_drawn_from_their_stored_tables(picture, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    redrawn.draw_stored(picture)
    old, new = redrawn.STORED[picture], tmp_path / f"{picture}.png"
    assert redrawn.changed(old, new) < redrawn.TOLERANCE


def test_a_legend_that_has_moved_is_noticed_and_fewer_colours_are_not(tmp_path):
    old = redrawn.STORED["parameter_plane"]
    image = Image.open(old).convert("RGB")
    image.quantize(64).save(tmp_path / "fewer.png")  # as few as any script keeps
    assert redrawn.changed(old, tmp_path / "fewer.png") < redrawn.TOLERANCE / 2
    ImageDraw.Draw(image).rectangle((150, 35, 250, 60), fill="black")  # a word or two
    image.save(tmp_path / "legend.png")
    assert redrawn.changed(old, tmp_path / "legend.png") > redrawn.TOLERANCE
