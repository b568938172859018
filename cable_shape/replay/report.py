"""The report of a replay: report.json for programs, report.md for people, report.png to look at."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cable_shape.files.files import finite
from cable_shape.pose import Grip

if TYPE_CHECKING:
    from cable_shape.cable.cable_file import Held
    from cable_shape.replay.outcome import Outcome
    from cable_shape.replay.settings import Settings

Row = tuple[str, str]


def write_report(outcome: Outcome, folder: Path) -> None:
    """Writes report.json, report.md and, unless the settings say no, report.png."""
    summary = summarise(outcome)
    text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")
    (folder / "report.md").write_text(as_markdown(summary), encoding="utf-8")
    if outcome.settings.picture:
        from cable_shape.replay.picture import draw

        draw(outcome, folder / "report.png")


def summarise(outcome: Outcome) -> dict[str, Any]:
    """Everything the report says, as plain values in SI units; lengths of markers as a fraction of the cable."""
    settings = outcome.settings
    return {
        "recording": {
            "path": str(outcome.bag),
            "complete": not outcome.problems,
            "problems": list(outcome.problems),
            "notes": list(outcome.notes),
            "topics": {
                topic: {"messages_read": read, "messages_recorded": recorded}
                for topic, (read, recorded) in outcome.topics.items()
            },
        },
        "input": {
            "source": outcome.source,
            "frame_id": outcome.frame_id,
            "max_skew": settings.max_skew,
            "unpaired": outcome.unpaired,
            "refused": [
                {"topic": r.topic, "reason": r.reason, "messages": r.count, "first_example": r.example}
                for r in outcome.refusals
            ],
        },
        **_carried(settings),
        "settings": {
            "model": settings.model,
            "gravity": list(settings.gravity),
            "points": settings.points,
            "tolerance": settings.tolerance,
            **_grips(settings, outcome.source),
            "scene": settings.scene is not None,
            "robot": settings.robot is not None,
            "uncertainty": settings.uncertainty is not None,
            "picture": settings.picture,
        },
        "replay": outcome.tally.as_dict(),
        "edits": outcome.edits,
        "inertia": _inertia(outcome),
        "markers": _markers(outcome),
    }


def _carried(settings: Settings) -> dict[str, Any]:
    """The cable, or the harness."""
    cable, file = settings.cable, settings.harness
    if file is not None:
        words = "; ".join(f"{name}: {one.describe()}" for name, one in file.harness.segments.items())
        return {"harness": {"name": file.name, **file.harness.as_dict()}, "cable_in_words": words}
    assert cable is not None
    return {
        "cable": {name: _plain(value) for name, value in cable.as_dict().items()},
        "cable_in_words": cable.describe(),
    }


def _grips(settings: Settings, source: str) -> dict[str, Any]:
    """How the grips hold it."""
    kind = "clamped" if source != "joints" else "as the robot's file says"
    if settings.harness is not None:
        held = settings.harness.held(settings.held_ends, settings.scene)
        kinds = {end: grip.kind if source != "joints" else kind for end, grip in held.items() if isinstance(grip, Grip)}
        return {"held_ends": kinds, "grips_in_words": "; ".join(f"{end} {how}" for end, how in kinds.items())}

    def words(held: Held) -> str:
        return ", ".join(part for part in ("" if held.kind else kind, held.describe()) if part)

    return {
        "start_kind": settings.start.kind or kind,
        "end_kind": settings.end.kind or kind,
        "start_correction": settings.start.as_dict().get("correction"),
        "end_correction": settings.end.as_dict().get("correction"),
        "grips_in_words": f"start {words(settings.start)}; end {words(settings.end)}",
    }


def _inertia(outcome: Outcome) -> dict[str, Any] | None:
    """What loaded the cable beside its weight; None: nothing did."""
    inertia = outcome.inertia
    if inertia is None:
        return None
    return {"source": inertia.source, "cycles": inertia.cycles, "cycles_without": inertia.without}


def _markers(outcome: Outcome) -> dict[str, Any] | None:
    """Distances of the markers; None if none were recorded."""
    markers, known = outcome.markers, outcome.settings.uncertainty
    if markers is None:
        return None
    figures = markers.figures()
    seen = markers.frames + markers.unpaired + markers.unusable
    if figures is None and not seen:
        return None
    return {
        "frames_compared": markers.frames,
        "frames_without_a_shape": markers.unpaired,
        "frames_with_an_unusable_shape": markers.unusable,
        "markers_not_finite": markers.not_finite,
        "distances": figures.distances if figures else 0,
        "mean": figures.mean if figures else None,
        "median": figures.median if figures else None,
        "p90": figures.p90 if figures else None,
        "worst": figures.worst if figures else None,
        "distances_with_a_tube": figures.with_tube if figures else 0,
        "inside_the_tube": figures.inside if figures else None,
        "confidence_of_the_tube": None if known is None else known.confidence,
    }


def as_markdown(summary: dict[str, Any]) -> str:
    """The report as a page."""
    recording, replayed = summary["recording"], summary["replay"]
    lines = [f"# Replay of {Path(recording['path']).name}", ""]
    if not recording["complete"]:
        lines += ["**Only a part of the recording could be read.**", ""]
        lines += [f"- {problem}" for problem in recording["problems"]] + [""]
    lines += [f"- {note}" for note in recording["notes"]] + ([""] if recording["notes"] else [])
    lines += _table(("", ""), headline(summary))
    lines += ["", f"{'Harness' if 'harness' in summary else 'Cable'}: {summary['cable_in_words']}.", ""]
    if "harness" in summary:
        head = ("segment", "smallest bend radius", "largest tension", "closest approach")
        lines += ["## Segments", "", *_table(head, list(_segments(replayed))), ""]
    lines += ["## Warnings", ""]
    if replayed["warnings"]:
        rows = [
            (
                w["severity"],
                _about(w, "harness" in summary),
                str(w["cycles"]),
                f"{w['first_time']:.3f} s",
                f"{w['worst_time']:.3f} s",
                w["text"],
            )
            for w in replayed["warnings"]
        ]
        lines += _table(("severity", "kind", "cycles", "first at", "worst at", "worst, in words"), rows)
    else:
        lines += ["None."]
    lines += ["", "## Input", ""]
    topics = [
        (
            topic,
            str(counts["messages_read"]),
            "?" if counts["messages_recorded"] is None else str(counts["messages_recorded"]),
        )
        for topic, counts in recording["topics"].items()
    ]
    lines += _table(("topic", "messages read", "recorded"), topics)
    refused = summary["input"]["refused"]
    if refused:
        lines += ["", "Messages that were refused, so that no cycle was run from them:", ""]
        reasons = [(r["topic"], r["reason"], str(r["messages"]), r["first_example"]) for r in refused]
        lines += _table(("topic", "reason", "messages", "first example"), reasons)
    lines += ["", "![Replay over time](report.png)", ""] if summary["settings"]["picture"] else [""]
    return "\n".join(lines)


def headline(summary: dict[str, Any]) -> list[Row]:
    """The figures that matter, in words, for the page and for the terminal."""
    return list(_headline(summary))


def _headline(summary: dict[str, Any]) -> Iterator[Row]:
    replayed, times = summary["replay"], summary["replay"]["cycle_time"]
    yield (
        "cycles",
        f"{replayed['cycles']}" + (f" ({replayed['reused']} reused the last shape)" if replayed["reused"] else ""),
    )
    yield "grips", summary["settings"]["grips_in_words"]
    inertia = summary["inertia"]
    if inertia is not None:
        missing = inertia["cycles_without"]
        left = f"; in {missing} they are not known, and it is predicted as at rest" if missing else ""
        yield "inertia", f"{inertia['source']}, load it in {inertia['cycles']} cycles{left}"
    yield "models", ", ".join(f"{model} {count}" for model, count in replayed["model"].items())
    yield "status", ", ".join(f"{status} {count}" for status, count in replayed["status"].items())
    if replayed["clock_restarts"]:
        yield "clock set back", f"{replayed['clock_restarts']} times; the shapes after it start afresh"
    if summary["edits"]:
        yield "edits repeated", str(summary["edits"])
    refused = sum(entry["messages"] for entry in summary["input"]["refused"])
    if refused or summary["input"]["unpaired"]:
        yield "input left out", f"{refused} messages refused, {summary['input']['unpaired']} without a partner"
    yield (
        "cycle time",
        "p50 {:.0f} µs, p99 {:.0f} µs, max {:.0f} µs".format(*(times[k] * 1e6 for k in ("p50", "p99", "max"))),
    )
    yield "closest approach", _closest(summary)
    if replayed["smallest_bend_radius"] is not None:
        yield "smallest bend radius", f"{replayed['smallest_bend_radius'] * 1e3:.1f} mm"
    if replayed["largest_tension"] is not None:
        yield "largest tension", f"{replayed['largest_tension']:.3g} N"
    if "cable" in summary:
        chord, length = replayed["longest_chord"], summary["cable"]["length"]
        yield "longest chord", f"{chord:.4f} m, {100.0 * chord / length:.1f} % of the cable's length"
    yield "warnings", "; ".join(_count(w, "harness" in summary) for w in replayed["warnings"]) or "none"
    markers = summary["markers"]
    if markers is not None:
        yield "markers to centreline", _distances(markers)
        if markers["inside_the_tube"] is not None:
            share, told = 100.0 * markers["inside_the_tube"], 100.0 * markers["confidence_of_the_tube"]
            yield "markers inside the tube", f"{share:.1f} % of {markers['distances_with_a_tube']}; it tells {told:g} %"


def _segments(replayed: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """A row for each segment of a harness."""
    for name, part in replayed["parts"].items():
        radius, tension, closest = (
            part[key] for key in ("smallest_bend_radius", "largest_tension", "closest_approach")
        )
        yield (
            name,
            "" if radius is None else f"{radius * 1e3:.1f} mm",
            "" if tension is None else f"{tension:.3g} N",
            "nothing came near" if closest is None else _approach(closest),
        )


def _about(warning: dict[str, Any], named: bool) -> str:
    """Its kind, what it is about and, if it is to be named, the segment."""
    segment = f"{warning['cable_id']}: " if named else ""
    other = f" ({warning['other']})" if warning["other"] else ""
    return f"{segment}{warning['kind']}{other}"


def _count(warning: dict[str, Any], named: bool) -> str:
    """How often one kind of warning was given."""
    about = f"{warning['kind']} {warning['severity']}" + (f" ({warning['other']})" if warning["other"] else "")
    segment = f"{warning['cable_id']} " if named else ""
    return f"{segment}{about} in {warning['cycles']} cycles"


def _closest(summary: dict[str, Any]) -> str:
    closest = summary["replay"]["closest_approach"]
    if closest is not None:
        return f"{_approach(closest)} along {'the cable' if 'cable' in summary else closest['cable_id']}"
    settings = summary["settings"]
    if not settings["scene"] and not settings["robot"]:
        return "not checked: no scene and no robot were given"
    return "nothing came near"


def _approach(closest: dict[str, Any]) -> str:
    return (
        f"{closest['distance'] * 1e3:.1f} mm to {closest['body']} at {closest['time']:.3f} s, "
        f"{closest['arc_length']:.3f} m"
    )


def _distances(markers: dict[str, Any]) -> str:
    if markers["mean"] is None:
        return "no frame could be compared"
    figures = "mean {:.2f} %, median {:.2f} %, p90 {:.2f} %".format(
        *(100.0 * markers[k] for k in ("mean", "median", "p90"))
    )
    left_out = markers["frames_without_a_shape"] + markers["frames_with_an_unusable_shape"]
    more = f", {left_out} frames left out" if left_out else ""
    return f"{figures} of the length ({markers['frames_compared']} frames{more})"


def _table(head: tuple[str, ...], rows: list[Any]) -> list[str]:
    """Lines of a Markdown table."""

    def line(cells: Any) -> str:
        return "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"

    return [line(head), line("---" for _ in head), *(line(row) for row in rows)]


def _plain(value: Any) -> Any:
    return finite(value) if isinstance(value, float) else value
