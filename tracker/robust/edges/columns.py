"""Names of the columns and codes of arrays that kernels share."""

SILHOUETTE_POSITIVE, SILHOUETTE_NEGATIVE, CREASE, OUTSIDE = 1, -1, 0, 9
"""Side of a control point: side of its normal with the only visible face; both faces visible; outside the image."""
BOTH_FACES = 3
"""Bits of the visible faces of an edge, both set."""
EDGE, FACES, PART = 0, 1, 2
"""Columns of a control point's key: its edge, the bits of its visible faces, the part of the edge."""
BINS = 8
"""Number of parts of an edge, each with its own appearance."""
U, V, NORMAL_U, NORMAL_V = 0, 1, 2, 3
"""Columns of a search line: pixel of its middle, unit normal of the edge there."""
NEGATIVE_COLOUR, POSITIVE_COLOUR, TIMES_SEEN, MEAN_SQUARE = 0, 3, 6, 7
"""Columns of a row of appearance: mean colour (three columns) on the negative and on the positive side of the normal;
number of observations; mean square of its residuals, px^2.
"""
APPEARANCE_COLUMNS = 8
BLOWN, ROUNDED = -2, -1
"""Last of the numbers that all edges share: shift in px of edges beside what is blown out, towards their dark sides;
radius of rounded borders."""
BESIDE = 3
"""Distances in px at which the colours beside an edge are sampled."""
