"""Where a copy lies on its original: which mesh, which pose, which map; no key is involved."""
