"""Names of what stands in the columns and codes of arrays that kernels share."""

SILHOUETTE_POSITIVE, SILHOUETTE_NEGATIVE, CREASE, OUTSIDE = 1, -1, 0, 9
"""Side of a control point: of its normal on which the only visible face lies; both are visible; not in the image."""
BOTH_FACES = 3
"""Bits of the visible faces of an edge, both set."""
EDGE, FACES, PART = 0, 1, 2
"""Columns of a control point's key: its edge, the bits of its visible faces, the part of the edge."""
TIMES_SEEN, MEAN_SQUARE = 6, 7
"""Columns of a row of appearance behind its six colours: how often it was seen; mean square of its residuals, px^2."""
