"""Estimate the sensor's own errors: gyroscope offset and scale, accelerometer errors; find still
stretches.
"""
