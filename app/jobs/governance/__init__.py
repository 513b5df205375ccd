"""What is decided about the data: releases, terms, published group figures."""
