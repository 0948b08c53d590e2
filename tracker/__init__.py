"""Model-based trackers: one stage per file, one short file per variant."""
