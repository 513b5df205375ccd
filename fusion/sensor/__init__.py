"""Estimate the sensor's errors: gyroscope offset and scale, accelerometer errors; find still stretches."""
