"""What is held: cables, their sections and wires, harnesses of them, and their files."""
