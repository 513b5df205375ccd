"""What every request passes before its route, and what its refusals become."""
