"""Trackers of others: programs that uavbench runs beside its own, and never links or imports."""
