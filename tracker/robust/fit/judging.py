"""What a fit found: its support, and how likely a random pose finds as much."""

import math
from typing import NamedTuple

from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.robust.edges.weight_kernels import found_parts
from uavbench.tracker.robust.fit.kernel_config import KernelConfig
from uavbench.tracker.robust.fit.pose_fit import Fit, FitResiduals, Searched
from uavbench.tracker.robust.fit.stage_kernels import Located, Weightings, judge
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Array, Pose

NOWHERE = (math.nan, math.nan, math.nan)


class Judge(NamedTuple):
    """What the matches of a search are judged by: appearance of the edges, and the values of the config."""

    appearance: Array
    values: KernelConfig

    def fit(self, searched: Searched, at: Located) -> Fit:
        """The fit to the matches of a search, at an estimate from them, with the support that they have."""
        problem, aligned, found, chosen = searched
        points, correlation, matched = problem.points, aligned.matches.correlation, found.estimate.weighting
        (R, t, step, sums, weighting), n = at.estimate, len(points.points)
        seen = unchecked(judge)(
            found.measured,
            problem.counts,
            Weightings(matched, weighting),
            correlation,
            aligned.view.to(found.estimate.R, found.estimate.t),
            self.appearance,
            self.values,
        )
        (ahead_x, ahead_y, ahead_z), (x, y, z) = R[2].tolist(), points.points[n // 2].tolist() if n else NOWHERE
        return Fit(
            Pose(R, t),
            inverse6(step.information),
            seen.support,
            n,
            seen.candidates,
            seen.inliers,
            ahead_x * x + ahead_y * y + ahead_z * z + float(t[2]),
            seen.edge_support,
            seen.found,
            seen.chance,
            FitResiduals(
                points,
                chosen,
                correlation,
                weighting,
                found.edges,
                sums,
                step,
                problem.prior.information,
                at.steps,
                at.by_numbers,
            ),
            searched,
        )

    def parts(self, searched: Searched) -> Array:
        """Part (n,) of each control point that a search found."""
        found = searched.found
        return found_parts(
            found.measured, found.estimate.weighting.weight, self.appearance, self.values.appearance.weak_step_grey
        )
