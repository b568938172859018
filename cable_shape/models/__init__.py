"""One solver a file: `solve(problem, guess) -> CableShape`."""
