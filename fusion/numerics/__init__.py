"""Small pieces of mathematics that several steps share, each written once."""
