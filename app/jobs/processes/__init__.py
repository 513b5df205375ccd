"""Which process does what: pools of workers, their leases, the leader, and a cluster of machines."""
