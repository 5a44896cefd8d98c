"""What USD's files are called, and its reader."""

READER = "usd"
STAGE_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
# Packages are only read.
LAYER_SUFFIXES = (".usd", ".usda", ".usdc")
# What becomes of a rigged mesh: its posed points are baked, or its rest pose is marked.
BAKE, REST_POSE = "bake", "rest"
# What becomes of what hangs on points that slide: it takes its value there, or keeps its own.
FOLLOW, KEEP = "follow", "keep"
