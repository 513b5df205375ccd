"""What speaks HTTP: the API, the pages, and what stands before both."""
