"""Accuracy of the laboratory's measurements, for checks/README.md and study/table-4.md.

``python checks/laboratory.py [accuracy|estimates|bases|time|imperfections|cases ...]`` prints the
tables, by default all; ``--figures DIR`` writes figures; ``--films N`` and ``--seed S`` set the
number and the first seed of the films of ``bases``.  Exit code 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import betaincinv

from vibrosweep.errors import TrackError
from vibrosweep.figures.laboratory import errors_by_case, fitted_track
from vibrosweep.figures.registry import save_formats
from vibrosweep.figures.style import for_file
from vibrosweep.lab.ballistics import Input
from vibrosweep.lab.base_fit import Inputs, find_contacts
from vibrosweep.lab.compare import QUANTITIES, compare_tracks
from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.experiment import (
    LABORATORY,
    Camera,
    Experiment,
    oscillating_surface,
    read_experiments,
)
from vibrosweep.lab.fitting import Setup, base_at_rest, fit_tracks, flights_over
from vibrosweep.lab.flights import fit_parabolas, samples_of
from vibrosweep.lab.impacts import BOUNCED, impacts_of
from vibrosweep.lab.lines import flights_of, table_lines
from vibrosweep.lab.traces import make_trace
from vibrosweep.lab.tracks import find_swaps
from vibrosweep.lab.trials import perform_trials
from vibrosweep.model.orbit_theory import amplitude_max

sys.path.append(str(Path(__file__).parents[1]))  # the directory of the study

from study.figures.imperfections import imperfections
from study.table4 import CASES, STUDY, study_imperfections, verdict

LEVEL = Setup(motion="level")
ROOT = Path(__file__).parents[1]
SWEEPS = ROOT / "sweeps" / "laboratory"
G = LABORATORY["gravity"]
QUARTER, COVERAGE = 0.25, (0.60, 0.76)
# Irregular films: `share` is relative to the largest amplitude with a stable (1, 1) mode
DRAWN = {
    "restitution": (0.5, 0.95),
    "frequency": (10.0, 30.0),
    "share": (1.05, 2.2),
    "noise": (3e-5, 1e-4),
    "phase": (-np.pi, np.pi),
    "launch_velocity": (0.15, 0.4),
    "transient": (0.0, 3.0),
}
WRONG = 0.01  # largest share of films attributed to the wrong base


def at(frequency, **changes):
    """Table 1 scaled to another frequency: the same kick and first flight in periods."""
    scaled = {"amplitude": 1.2 / frequency, "launch_velocity": 5.0 / frequency}
    return {**LABORATORY, "frequency": frequency, "phase": np.pi, **scaled, **changes}


SCENES = {
    "locked, 8 Hz": at(8.0),
    "locked, 23 Hz": at(23.0),
    "locked, 35 Hz": at(35.0),
    "irregular, 20 Hz, e = 0.85": at(20.0, amplitude=0.12, restitution=0.85),
}


def differences(impacts, record):
    """Landing times of bounces minus the nearest true ones, in s, and their standard errors."""
    off, error = [], []
    for p in range(impacts.sizes["particle"]):
        good = impacts["quality"].values[p] == BOUNCED
        when = impacts["landing_time"].values[p, good]
        true = record.landing_time[p][np.isfinite(record.landing_time[p])]
        place = np.clip(np.searchsorted(true, when), 1, true.size - 1)
        before, after = when - true[place - 1], when - true[place]
        off.append(np.where(np.abs(before) < np.abs(after), before, after))
        error.append(impacts["landing_time_error"].values[p, good])
    return np.concatenate(off), np.concatenate(error)


def accuracy():
    """Errors of landing times by frame rate and method."""
    print(
        "\n| orbit | frames/s | bounces | rms error, frames | bias, frames | 68 % cover |"
        " sign change: rms, frames |\n|---|---|---|---|---|---|---|"
    )
    reached = True
    for name, scene in SCENES.items():
        for rate in (240.0, 120.0):
            plan = Experiment(**scene, particles=5, repeats=1, camera=Camera(rate), seed=1)
            trial = perform_trials(plan)[0]
            fitted = fit_or_reason(trial.tracks)
            if isinstance(fitted, str):
                print(f"| {name} | {rate:g} | refused: {fitted} | | | | |")
                continue
            off, error = differences(impacts_of(trial.tracks, fitted, G, "fit"), trial.record)
            sign, _ = differences(impacts_of(trial.tracks, fitted, G, "sign_change"), trial.record)
            rms, cover = np.sqrt(np.mean(off**2)) * rate, np.mean(np.abs(off) < error)
            print(
                f"| {name} | {rate:g} | {off.size} | {rms:.3f} | {off.mean() * rate:+.4f} | "
                f"{100 * cover:.1f} % | {np.sqrt(np.mean(sign**2)) * rate:.3f} |"
            )
            if rate == 240.0:
                reached &= rms < QUARTER and COVERAGE[0] < cover < COVERAGE[1]
    return reached


def fit_or_reason(tracks):
    try:
        return fit_tracks(tracks, G, LEVEL)
    except TrackError as error:
        return str(error).split(": ", 1)[1]


def estimates():
    """Deviations of estimated parameters from the truth, in standard errors."""
    print(
        "\n| orbit | frequency | parameter | truth | typical error | mean square deviation,"
        " errors^2 | determined |\n|---|---|---|---|---|---|---|"
    )
    recordings, reached = 40, True
    for name in ("irregular, 20 Hz, e = 0.85", "locked, 23 Hz"):
        scene = {**SCENES[name], "phase": 0.0 if "irregular" in name else np.pi}
        plan = Experiment(**scene, particles=3, repeats=recordings, duration=30.0)
        impacts = [
            impacts_of(t.tracks, fit_tracks(t.tracks, G, LEVEL), G, "fit")
            for t in perform_trials(plan)
        ]
        for known in (scene["frequency"], None):
            found = [estimate(one, frequency=known) for one in impacts]
            determined = sum(int(one["determined"]) for one in found)
            if not determined:
                print(
                    f"| {name} | {'given' if known else 'estimated'} | all | | | | 0 of "
                    f"{recordings} |"
                )
                reached &= "locked" in name
                continue
            for k, parameter in enumerate(found[0]["parameter"].values):
                off = np.array([float(f["estimate"][k]) - scene[parameter] for f in found])
                error = np.array([float(f["error"][k]) for f in found])
                square = float(np.mean((off / error) ** 2))
                print(
                    f"| {name} | {'given' if known else 'estimated'} | {parameter} | "
                    f"{scene[parameter]:g} | {np.median(error):.2g} | {square:.2f} | "
                    f"{determined} of {recordings} |"
                )
                # 99.9 % interval of the mean of 40 squared normal deviates
                reached &= 0.4 < square < 1.95 and determined == recordings
    return reached


def irregular_film(base, seed):
    """A film of irregular motion, with parameters from the ranges of `DRAWN`, and its scene."""
    rng = np.random.default_rng((seed, ["high-bounce", "moving"].index(base)))
    drawn = {name: rng.uniform(*between) for name, between in DRAWN.items()}
    e, frequency = drawn["restitution"], drawn["frequency"]
    scene = {
        **LABORATORY,
        "restitution": e,
        "amplitude": drawn["share"] * float(amplitude_max(1, e, frequency, base=base)),
        "frequency": frequency,
        "phase": drawn["phase"],
        "launch_velocity": drawn["launch_velocity"],
    }
    camera = Camera(frame_rate=float(rng.choice((240.0, 480.0))), pixel=drawn["noise"])
    plan = Experiment(
        **scene,
        base=base,
        particles=3,
        repeats=1,
        transient=drawn["transient"],
        duration=drawn["transient"] + 6.0,
        camera=camera,
        seed=seed,
    )
    return perform_trials(plan)[0].tracks, scene


def interval(count, number):
    """95 % confidence interval of a share (Clopper and Pearson 1934), in per cent."""
    low = betaincinv(count, number - count + 1, 0.025) if count else 0.0
    high = betaincinv(count + 1, number - count, 0.975) if count < number else 1.0
    return f"{100 * low:.2g} to {100 * high:.2g} %"


def deviations(estimated, scene):
    """Estimates minus the truth in standard errors."""
    names = [str(name) for name in estimated["parameter"].values]
    off = estimated["estimate"].values - [scene[name] for name in names]
    turn = names.index("phase")
    off[turn] = np.angle(np.exp(1j * off[turn]))
    return off / estimated["error"].values


def bases(films, first):
    """Count the bases found in irregular films, and estimates with large deviations."""
    print(
        "\n| base | frequency | films | right | wrong (95 %) | undetermined | refused |"
        " determined | beyond 4 errors | of these with a warning | scale corrected |\n"
        + "|---" * 11
        + "|"
    )
    reached = True
    for base, truth in (("high-bounce", "level"), ("moving", "moving")):
        for known in (True, False):
            counts, far, warned, rescaled, number = Counter(), 0, 0, 0, 0
            for seed in range(first, first + films):
                tracks, scene = irregular_film(base, seed)
                rate = scene["frequency"] if known else None
                try:
                    fitted = fit_tracks(tracks, G, Setup(frequency=rate))
                except TrackError:
                    counts["refused"] += 1
                    continue
                counts[fitted.favoured_base] += 1
                rescaled += fitted.flights.curvature != G
                try:
                    found = estimate(impacts_of(tracks, fitted, G, "fit"), frequency=rate)
                except TrackError:  # too few bounces
                    continue
                reached &= not int(found["determined"]) or 0.0 <= float(found["estimate"][0]) <= 1.0
                # estimates are valid only for the right base
                if not int(found["determined"]) or fitted.favoured_base == "undetermined":
                    continue
                number += 1
                beyond = np.abs(deviations(found, scene)).max() > 4.0
                far += beyond
                warned += beyond and found.attrs["warning"] != ""
            other = {"level": "moving", "moving": "level"}[truth]
            print(
                f"| {base} | {'given' if known else 'estimated'} | {films} | {counts[truth]} | "
                f"{counts[other]} ({interval(counts[other], films)}) | {counts['undetermined']} | "
                f"{counts['refused']} | {number} | {far} | {warned} | {rescaled} |",
                flush=True,
            )
            reached &= counts[other] <= WRONG * films
    return reached


def timing():
    """CPU time of a 60 s recording of 50 particles at 240 frames per second, step by step."""
    plan = Experiment(**SCENES["locked, 23 Hz"], particles=50, repeats=1, duration=80.0)
    tracks = perform_trials(plan)[0].tracks
    when, height = tracks["time"].values, tracks["height"].values
    spent = {}

    def step(name, call):
        began = time.process_time()
        result = call()
        spent[name] = time.process_time() - began
        return result

    samples = step(
        "samples and pieces", lambda: samples_of(when, height, np.zeros(height.shape, bool))
    )
    cut = step("stretches of flight and contacts", lambda: find_contacts(samples, G))
    base = step("base at rest", lambda: base_at_rest(samples, cut, None, 0.0))
    inputs = Inputs(Input(G))
    flights = step(
        "flights: fitted, reassigned", lambda: flights_over(samples, cut, base, 0.0, inputs)
    )
    step(
        "one fit of all parabolas, of eight",
        lambda: fit_parabolas(samples, flights.member, flights.piece.size, G),
    )
    step("exchanged names", lambda: find_swaps(when, height, flights.noise, flights.base, G))
    fitted = fit_tracks(tracks, G, LEVEL)
    step("table of landings", lambda: impacts_of(tracks, fitted, G, "fit"))
    print(f"\n{height.size} positions\n\n| step | CPU s |\n|---|---|")
    for name, seconds in spent.items():
        print(f"| {name} | {seconds:.2f} |")
    return True


def imperfect(figures, duration):
    """Errors due to each single imperfection."""
    study = study_imperfections(duration=20.0 + duration)
    shown = (("fit", "particle"), ("sign_change", "particle"), ("sign_change", "flight"))
    print("\n| imperfection | " + " | ".join(f"{p}, {r}: A B C D" for p, r in shown) + " |")
    print("|---|" + "---|" * len(shown))
    for i, name in enumerate(study["imperfection"].values):
        cells = []
        for procedure, reading in shown:
            pair = []
            for q in ("height", "period"):
                error = study[f"{q}_error"][i].sel(procedure=procedure, reading=reading).values
                pair.append(" ".join(f"{v:.1f}" for v in error))
            cells.append(" / ".join(pair))
        units = str(study["units"].values[i])
        unit = "" if units == "1" else f" {units}"
        print(
            f"| {name.replace('_', ' ')} {study['size'].values[i]:g}{unit} | {' | '.join(cells)} |"
        )
    print()
    print("\n".join(f"- {line}" for line in verdict(study)))
    if figures:
        save_formats(
            for_file(imperfections, study, "flight", "sign_change"),
            figures,
            "laboratory_imperfections",
        )
    return True


def cases(figures, duration):
    """The four cases of sweeps/laboratory/table4.toml, compared with prediction."""
    spec = read_experiments(SWEEPS / "table4.toml")
    recordings, known = [], {}
    for one in spec.experiments:
        one = replace(one, scene=replace(one.scene, duration=20.0 + duration))
        known = {
            n: one.parameters[n] for n in ("restitution", "amplitude", "frequency", "contact_time")
        }
        recordings += [trial.tracks for trial in perform_trials(one)]
    for method in ("fit", "sign_change"):
        how = {"method": method, "exposure": 1e-3, "motion": "level", "threads": 2}
        table = compare_tracks(recordings, **how, **known)
        table.attrs |= {f"study_{q}": STUDY[q] for q in QUANTITIES}
        print(f"\n{method}\n\n```\n" + "\n".join(table_lines(table)) + "\n```")
        if figures:
            table["case"] = [f"{letter}\nN = {count}" for letter, count in CASES.items()]
            save_formats(for_file(errors_by_case, table), figures, f"laboratory_table4_{method}")
    return True


def drawn(figures):
    """The track of a locked and of an irregular orbit, with residuals."""
    for name, stem in (("locked, 23 Hz", "locked"), ("irregular, 20 Hz, e = 0.85", "irregular")):
        plan = Experiment(**SCENES[name], particles=3, repeats=1, duration=30.0)
        tracks = perform_trials(plan)[0].tracks
        figure = for_file(fitted_track, flights_of(tracks, fit_tracks(tracks, G, LEVEL)))
        save_formats(figure, figures, f"laboratory_track_{stem}")
    (plan,) = read_experiments(SWEEPS / "two_tones.toml").experiments
    plan = replace(plan, repeats=1, scene=replace(plan.scene, duration=26.0))
    time = np.arange(20.0, 26.0, 1e-3)
    height = oscillating_surface(plan.parameters, plan.scene.waveform).height(time)
    height += 1e-5 * np.random.default_rng(1).standard_normal(time.size)
    setup = Setup(trace=make_trace(time, height, "height"))
    tracks = perform_trials(plan)[0].tracks
    figure = for_file(fitted_track, flights_of(tracks, fit_tracks(tracks, G, setup)))
    save_formats(figure, figures, "laboratory_two_tones")
    return True


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--figures", type=Path)
    parser.add_argument(
        "--duration", type=float, default=40.0, help="duration of each repeat of Table 4, s"
    )
    parser.add_argument(
        "--films", type=int, default=300, help="number of films for each base and task"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the first film")
    options = parser.parse_args()
    parts = {
        "accuracy": accuracy,
        "estimates": estimates,
        "bases": lambda: bases(options.films, options.seed),
        "time": timing,
        "imperfections": lambda: imperfect(options.figures, options.duration),
        "cases": lambda: cases(options.figures, options.duration),
    }
    reached = [parts[part]() for part in options.parts or parts]
    if options.figures:
        drawn(options.figures)
    return 0 if all(reached) else 1


if __name__ == "__main__":
    sys.exit(main())
