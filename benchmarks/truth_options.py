"""What cross validation on recordings says of options of a fit: rolls that are held, supports, stiffness along the
cable. It sees the frames that the first fit of each cable is made of, and no other."""

from __future__ import annotations

from figures import heading
from tqdm import tqdm
from truth_limits import line

import cable_shape as cs
from cable_shape.calibration.supports import Judge, Task, joined, priors_of

#: Of these frames, so many are used.
EVERY = 3
#: name -> (kind of both grips, what is fitted beside or in place of the usual, supports more than usual).
OPTIONS: dict[str, tuple[str, str, int]] = {
    "one stiffness": ("swivel", "", 0),
    "grips that hold the roll, one fitted": ("clamped", "roll", 0),
    "four supports fewer": ("swivel", "", -4),
    "four supports more": ("swivel", "", 4),
    "stiffness along the cable": ("swivel", "bending_stiffness_along", 0),
}


def held_as(seen: cs.Observation, kind: str) -> cs.Observation:
    """The same with grips of one kind at both ends."""
    assert isinstance(seen.end, cs.Grip)
    grips = cs.Grip(seen.start.pose, kind), cs.Grip(seen.end.pose, kind)
    return cs.Observation(*grips, seen.points, acceleration=seen.acceleration, group=seen.group)


def options(
    data: dict[int, tuple[list[cs.Observation], cs.Cable]], names: tuple[str, ...], priors: dict[str, float], rows: int
) -> dict[str, list[float]]:
    """Prints, and gives, mean misses in % of the length of frames that are left out, by options and cables.

    data: observations that may be fitted to, and where fits begin, by cable; names, priors, rows: what is usually
    fitted, and with how many supports.
    """
    heading(f"Options, by cross validation on every {EVERY}rd frame that is fitted: mean miss of what is left out, %")
    told: dict[str, list[float]] = {option: [] for option in OPTIONS}
    for number in tqdm(data, desc="options", unit="cable"):
        seen, cable = data[number]
        for option, (kind, more, supports) in OPTIONS.items():
            fit = joined(names, more) if more else names
            task = Task([held_as(o, kind) for o in seen[::EVERY]], cable, fit, priors_of(priors, fit), {})
            error = Judge(task, option, lambda i, scale: True).error(fit, rows + supports)
            told[option].append(100.0 * error / cable.length)
    print(f"{'':52}" + "".join(f"{f'cable{n}':>14}" for n in data))
    for option, values in told.items():
        line(option, values)
    return told
