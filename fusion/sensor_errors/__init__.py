"""What the sensor gets wrong, found from the recording itself: still moments and gyroscope bias."""
