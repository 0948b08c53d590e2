"""Images of one's own with known poses, as sequences with ground truth.

In: images, model, camera and a trajectory in any form that `evaluate` reads. Out: a sequence folder. Imports reports.
"""
