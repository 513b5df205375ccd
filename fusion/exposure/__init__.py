"""Compute how much the arm was raised: time in bins, percentiles, repetitions, episodes, peaks, speeds.

:mod:`acromion.fusion.exposure.types` defines the figures as values and does not load the compiler, so a
report can be written without it.
"""
