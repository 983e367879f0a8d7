"""The style contrastive loss, which draws codes of the same environment together and codes of others apart."""

from __future__ import annotations

import torch
from torch import Tensor

from motion_gym.contract import PredictorError

TEMPERATURE = 0.07


def style_loss(embedding: Tensor, environment: Tensor) -> Tensor:
    """Supervised contrastive loss of each model (Khosla et al., NeurIPS 2020, with the mean outside the logarithm).

    For an anchor i and each other scene j of its environment, the term is
    -log(exp(s_ij / t) / sum over k of exp(s_ik / t)), where s is the scalar product and t = 0.07. The loss is the mean
    over j, then over i. As in the released program, the sum is over all k except i, so positives repel each other too,
    and the loss of well separated codes is the logarithm of the number of positives. In the paper's Eq. 5 the sum is
    over j and the scenes of other environments only.

    Args:
        embedding: [M, S, 8] of unit length.
        environment: [S] int64 environment of each scene; each at least twice.

    Raises:
        PredictorError: there is only one environment.
    """
    same = environment[:, None] == environment
    if bool(same.all()):
        raise PredictorError(
            "The style loss compares environments, but all scenes are of one: give scenes of at least two."
        )
    logits = embedding @ embedding.transpose(1, 2) / TEMPERATURE
    positives = same.sum(dim=-1) - 1
    logits.diagonal(dim1=1, dim2=2).fill_(-torch.inf)
    # The mean logit with the other scenes of the same environment, from the sum of their embeddings.
    together = same.to(embedding.dtype) @ embedding - embedding
    alike = (embedding * together).sum(dim=-1) / positives / TEMPERATURE
    return (logits.logsumexp(dim=-1) - alike).mean(dim=-1)
