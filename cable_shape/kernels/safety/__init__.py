"""Loads, margins, tubes and batches, compiled."""
