"""Writes a KBL file of 180 segments, with which to try `cable-shape import`: python make_kbl.py [FILE.kbl]

A trunk of 60 segments with two branches at each of its nodes: uniform B-splines as CAD writes them, wires from the
trunk's start to every end, clips, tape, connectors.
"""

import math
import sys
from pathlib import Path

import cable_shape as cs

STEPS, STEP, BRANCH = 60, 60.0, 120.0  # of the trunk; mm
points, nodes, segments, wires, routings, occurrences = [], [], [], [], [], []


def point(x, y, z):
    numbers = "".join(f"<Coordinates>{v:.6f}</Coordinates>" for v in (x, y, z))
    points.append(f'<Cartesian_point id="P{len(points)}">{numbers}</Cartesian_point>')
    return f"P{len(points) - 1}"


def value(name, number, unit):
    return f"<{name}><Unit_component>{unit}</Unit_component><Value_component>{number:.6f}</Value_component></{name}>"


def node(name, place, parts=""):
    parts = f"<Cartesian_point>{point(*place)}</Cartesian_point><Referenced_components>{parts}</Referenced_components>"
    nodes.append(f'<Node id="{name}">{parts}</Node>')


def segment(name, start, end, a, b, more=""):
    line = [tuple(p + (q - p) * k for p, q in zip(a, b, strict=True)) for k in (-1, 0, 1, 2)]
    curve = "<Degree>3</Degree><Control_points>" + " ".join(point(*p) for p in line) + "</Control_points>"
    body = (
        value("Virtual_length", math.dist(a, b), "mm") + f"<Start_node>{start}</Start_node><End_node>{end}</End_node>"
    )
    segments.append(f'<Segment id="{name}">{body}<Center_curve>{curve}</Center_curve>{more}</Segment>')


def trunk(k):
    return (STEP * k, 40.0 * math.sin(0.15 * k), 700.0)


node("N0", trunk(0))
for k in range(1, STEPS + 1):
    more = node(f"N{k}", trunk(k)) or ""
    if k % 4 == 1:
        occurrences.append(f'<Fixing_occurrence id="F{k}"><Id>clip {k}</Id><Part>clip</Part></Fixing_occurrence>')
        more = f"<Fixing_assignment><Location>0.5</Location><Fixing>F{k}</Fixing></Fixing_assignment>"
    segment(f"T{k}", f"N{k - 1}", f"N{k}", trunk(k - 1), trunk(k), more)
    for side in (-1, 1):
        name = f"{'L' if side < 0 else 'R'}{k}"
        (x, y, z), tip = trunk(k), (trunk(k)[0] + 30.0, trunk(k)[1] + side * BRANCH, trunk(k)[2])
        occurrences.append(
            f'<Connector_occurrence id="C{name}"><Id>X{name}</Id><Part>plug</Part></Connector_occurrence>'
        )
        node(f"N{name}", tip, f"C{name}")
        tape = "<Start_location>0</Start_location><End_location>0.5</End_location>"
        tape = f"<Protection_area>{tape}<Associated_protection>tape1</Associated_protection></Protection_area>"
        segment(name, f"N{k}", f"N{name}", (x, y, z), tip, tape if k % 10 == 0 else "")
        wire = f'<General_wire_occurrence id="W{name}"><Part>wire</Part></General_wire_occurrence>'
        wires.append(f'{wire}<Connection id="K{name}"><Wire>W{name}</Wire></Connection>')
        way = " ".join([*(f"T{i}" for i in range(1, k + 1)), name])
        routings.append(f'<Routing id="Q{name}"><Routed_wire>K{name}</Routed_wire><Segments>{way}</Segments></Routing>')

mm = '<Unit id="mm"><Si_unit_name>metre</Si_unit_name><Si_prefix>milli</Si_prefix></Unit>'
gram = '<Unit id="g"><Si_unit_name>gram</Si_unit_name></Unit><Unit id="g_m">'
units = mm + gram + "<Unit_name>GramPerMetre</Unit_name></Unit>"
of_wire = value("Mass_information", 6.0, "g_m") + value("Outside_diameter", 1.6, "mm")
parts = f'<General_wire id="wire">{of_wire}</General_wire>'
parts += f'<Connector_housing id="plug">{value("Mass_information", 10.0, "g")}</Connector_housing>'
parts += f'<Fixing id="clip"/><Wire_protection id="tape">{value("Mass_information", 4.0, "g_m")}</Wire_protection>'
occurrences.append('<Wire_protection_occurrence id="tape1"><Part>tape</Part></Wire_protection_occurrence>')
body = "\n".join([*points, parts, "<Harness>", *occurrences, *wires, "</Harness>", *nodes, *routings, *segments, units])
out = [*sys.argv, "example.kbl"][1]
head = '<?xml version="1.0" encoding="UTF-8"?>\n<k:KBL_container xmlns:k="urn:kbl" version_id="2.4">'
Path(out).write_text(f"{head}\n{body}\n</k:KBL_container>\n", encoding="utf-8")
made = cs.Harness.from_kbl(out)
print(f"{out}: {len(made.segments)} segments, {len(made.clips)} clips, {made.wire_mass:.3f} kg of wires")
