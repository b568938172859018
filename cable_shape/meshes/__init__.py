"""Triangle meshes: files, and the tree that clearance searches."""
