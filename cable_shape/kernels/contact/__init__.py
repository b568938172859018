"""Cables pressed on bodies and on each other, compiled."""
