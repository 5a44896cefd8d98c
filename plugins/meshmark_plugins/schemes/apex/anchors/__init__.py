"""Where the tips of a shape are, in one pose and in all, and distances from them."""
