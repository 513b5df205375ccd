"""Bad inputs, by every way in, against what must become of them."""
