"""The sensor's own errors: offset of the gyroscope, errors of the accelerometer, scale, still stretches."""
