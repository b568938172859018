"""Whether a shape is safe: clearance, margins, stress, snaps, warnings, and the report of a cycle."""
