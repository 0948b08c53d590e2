"""What a fit found: its support, and how likely a random pose finds as much."""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.robust.edges.weight_kernels import found_parts, support
from uavbench.tracker.robust.fit.false_alarms import Found, chance
from uavbench.tracker.robust.fit.kernel_config import Widths
from uavbench.tracker.robust.fit.pose_fit import Fit, FitResiduals, Located, Searched
from uavbench.tracker.robust.solver.sum_kernels import Weighting
from uavbench.trajectories.pose import Array, Pose


class Judge(NamedTuple):
    """What the matches of a search are judged by: appearance of the edges, a weak step in grey levels, and widths."""

    appearance: Array
    weak_step: float
    widths: Widths

    def fit(self, searched: Searched, at: Located) -> Fit:
        """The fit to the matches of a search, at an estimate from them, with the support that they have."""
        problem, aligned, found, chosen = searched
        points, correlation, matched = problem.points, aligned.matches.correlation, found.estimate.weighting
        share = support(
            found.measured,
            problem.counts,
            matched.weight,
            matched.patch_weight,
            correlation,
            self.appearance,
            self.weak_step,
        )
        (R, t, step, sums, weighting), n = at.estimate, len(points.points)
        evidence = self.found(searched, weighting)
        middle = points.points[n // 2] if n else np.full(3, np.nan)
        return Fit(
            Pose(R, t),
            inverse6(step.information),
            share.whole,
            n,
            int(np.count_nonzero(found.measured.candidates.distance < np.inf)),
            int(np.count_nonzero(weighting.weight) + np.count_nonzero(weighting.patch_weight)),
            float(R[2] @ middle + t[2]),
            share.edges,
            float(matched.weight.sum() + np.count_nonzero(matched.patch_weight)),
            chance(evidence),
            evidence,
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
                at.by_response,
            ),
            searched,
        )

    def parts(self, searched: Searched) -> Array:
        """Part (n,) of each control point that a search found."""
        found = searched.found
        return found_parts(found.measured, found.estimate.weighting.weight, self.appearance, self.weak_step)

    def log10_chance(self, searched: Searched) -> float:
        """Decimal logarithm of the bound on the probability that a random pose finds as much as a search did."""
        return chance(self.found(searched, searched.found.estimate.weighting)).whole

    def found(self, searched: Searched, weighting: Weighting) -> Found:
        """What these weights say was found."""
        problem, aligned, solution, _ = searched
        return Found(
            problem.points.rows,
            solution.measured.candidates.distance,
            weighting.weight,
            weighting.patch_weight,
            aligned.matches.correlation,
            self.widths.last_px,
            self.widths.fine_half_px,
        )
