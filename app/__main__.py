"""Run the command line as ``python -m app``."""

from app.start import main

main()
