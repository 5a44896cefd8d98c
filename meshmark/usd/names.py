"""What USD's files are called, and its reader."""

READER = "usd"
STAGE_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
# Packages are only read.
LAYER_SUFFIXES = (".usd", ".usda", ".usdc")
