"""What a cable is, from how it was seen to hang: :func:`cable_shape.calibrate` and what it is made of."""
