"""How much the arm was raised: time in bins, percentiles, repetitions, episodes, peaks, speeds.

The figures as values are in :mod:`fusion.exposure.types`, which loads no compiler, so that a report can be
written without it.
"""
