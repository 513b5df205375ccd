"""Run the command line as ``python -m acromion``."""

from acromion.app.start import main

main()
