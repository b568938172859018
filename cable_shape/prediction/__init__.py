"""From ends to shape: the predictor, and which solver it asks."""
