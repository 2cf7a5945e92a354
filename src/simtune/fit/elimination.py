"""Normal equations of many experiments, each with unknowns of its own beside shared ones."""

from typing import NamedTuple

import numpy as np


class NormalEquations(NamedTuple):
    """Of W experiments with F unknowns of their own, and P unknowns shared by all."""

    hessian: np.ndarray  # (W, F, F) H, of the own unknowns
    cross: np.ndarray  # (W, F, P) C, own by shared unknowns
    gradient: np.ndarray  # (W, F) g, by the own unknowns
    information: np.ndarray  # (W, P, P) B − Cᵀ H⁻¹ C, on the shared unknowns
    shared_gradient: np.ndarray  # (W, P) b − Cᵀ H⁻¹ g

    def by_group(self, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(G, P, P) information and (G, P) gradients, summed over experiments of a `number`, (W,).

        Groups are in the order of their numbers.
        """
        groups = np.unique(number)[:, None] == number  # (G, W)
        return (
            np.einsum("gw,wpq->gpq", groups, self.information),
            np.einsum("gw,wp->gp", groups, self.shared_gradient),
        )

    def own_step(self, shared_step: np.ndarray) -> np.ndarray:
        """(W, F) −H⁻¹ (g + C δθ): what own unknowns do after a (P,) step δθ of the shared ones."""
        gradient = self.gradient + self.cross @ shared_step
        return -np.linalg.solve(self.hessian, gradient[..., None])[..., 0]

    def promised(self, information: np.ndarray, gradient: np.ndarray) -> float:
        """Decrease of the cost in a full linear step of own and shared unknowns.

        `information` (P, P) and `gradient` (P,): of the shared ones, summed over all experiments
        and the prior.
        """
        of_shared = gradient @ np.linalg.solve(information, gradient)
        own = np.linalg.solve(self.hessian, self.gradient[..., None])[..., 0]
        return float(of_shared + (self.gradient * own).sum()) / 2


def eliminate(
    hessian: np.ndarray,
    cross: np.ndarray,
    gradient: np.ndarray,
    direct: np.ndarray,
    direct_gradient: np.ndarray,
    *,
    ridged: np.ndarray | None = None,
) -> NormalEquations:
    """Eliminate each experiment's own unknowns x from its normal equations with the shared θ.

        [H   C] [δx]     [g]
        [Cᵀ  B] [δθ] = − [b]

    The first row gives δx = −H⁻¹ (g + C δθ). In the second row that leaves the Schur complement,

        (B − Cᵀ H⁻¹ C) δθ = −(b − Cᵀ H⁻¹ g)

    H (W, F, F), C (W, F, P) and g (W, F) are `hessian`, `cross` and `gradient`; B (W, P, P) and
    b (W, P) are `direct` and `direct_gradient`. `ridged`: (W, F, F) to invert in place of H.
    """
    follow = np.linalg.solve(hessian if ridged is None else ridged, cross)  # (W, F, P) H⁻¹ C
    information = direct - cross.swapaxes(1, 2) @ follow
    shared_gradient = direct_gradient - np.einsum("wsp,ws->wp", follow, gradient)
    return NormalEquations(hessian, cross, gradient, information, shared_gradient)
