"""Ground truth for model-based UAV localization: rendered inspection flights, trackers, and honest scores."""

__version__ = "0.1.0"
