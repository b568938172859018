"""What surrounds a cable: bodies, meshes, clips, masses, plugs, and the file of a scene."""
