"""The style contrastive loss: codes of scenes from one environment are drawn together, those of others apart."""

from __future__ import annotations

import torch
from torch import Tensor

from motion_gym.contract import PredictorError

TEMPERATURE = 0.07


def style_loss(embedding: Tensor, environment: Tensor) -> Tensor:
    """Supervised contrastive loss of each model (Khosla et al., NeurIPS 2020, the mean outside of the logarithm).

    For an anchor i and each other scene j of its environment: -log(exp(s_ij / t) / sum over k of exp(s_ik / t)), where
    s is the scalar product and t = 0.07; the mean over j, then over i. The released program sums over all k except i.
    The paper's Eq. 5 sums over j and the scenes of other environments alone. Here, as in the released program,
    positives repel each other, too, and the loss of well separated codes stays at the logarithm of the number of
    positives.

    Args:
        embedding: [M, S, 8] of unit length.
        environment: [S] int64 environment of each scene; each at least twice.

    Raises:
        PredictorError: there is one environment alone.
    """
    same = environment[:, None] == environment
    if bool(same.all()):
        raise PredictorError(
            "The style loss compares environments, and the scenes are all of one: give scenes of at least two."
        )
    logits = embedding @ embedding.transpose(1, 2) / TEMPERATURE
    positives = same.sum(dim=-1) - 1
    logits.diagonal(dim1=1, dim2=2).fill_(-torch.inf)
    # The mean logit with the others of one's environment, from their sum.
    together = same.to(embedding.dtype) @ embedding - embedding
    alike = (embedding * together).sum(dim=-1) / positives / TEMPERATURE
    return (logits.logsumexp(dim=-1) - alike).mean(dim=-1)
