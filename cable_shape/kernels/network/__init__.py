"""One solver for networks of rods: knots, spans between them, and what is unknown of both."""
