"""What an organisation decides about its data: releases, terms, published group figures."""
