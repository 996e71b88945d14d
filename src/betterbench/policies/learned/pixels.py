"""Network of the ``pixels`` family: a convolutional network with FiLM layers, whose key points become tokens."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from betterbench.policies.learned.network import ShownBatch, TokenNetwork
from betterbench.policies.learned.vocabulary import Vocabulary

_GROUPS = 4
_KERNELS, _STRIDES = (5, 3, 3, 3), (2, 2, 2, 1)


@dataclass(slots=True, kw_only=True)
class PicturesBatch(ShownBatch):
    """Inputs for a batch of learners in the ``pixels`` family, with V views per sample.

    Attributes:
        pictures: (B, V, size, size, 3) uint8 images.
        light: (B, 2) float32 random changes of contrast and brightness, or None to leave the images unchanged.
    """

    pictures: Tensor
    light: Tensor | None = None


class _Convolutions(nn.Module):
    """Convolutional network with FiLM that turns each image into one token."""

    def __init__(self, width: int, views: int) -> None:
        super().__init__()
        channels = (3, *channels_of(width))
        pairs = list(itertools.pairwise(channels))
        self.asked = nn.Linear(width, width)
        self.film = nn.ModuleList(nn.Linear(width, 2 * after) for _, after in pairs[1:])
        self.layers = nn.ModuleList(
            nn.Conv2d(before, after, kernel, stride, kernel // 2)
            for (before, after), kernel, stride in zip(pairs, _KERNELS, _STRIDES, strict=True)
        )
        self.point = nn.Linear(3 * channels[-1], width)
        self.view = nn.Embedding(views, width)

    def forward(self, pictures: Tensor, asked: Tensor, which: Tensor) -> Tensor:
        """Return one token per image as a (P, width) tensor.

        Args:
            pictures: (P, 3, size, size) images in channels-last memory layout.
            asked: (U, width) encodings of the U distinct instructions.
            which: (P,) index of the distinct instruction that belongs to each image.
        """
        # The first layer has no normalization: its feature map is the largest, so normalizing it would take most of the
        # time.
        seen = functional.relu(self.layers[0](pictures))
        for film, layer in zip(self.film, self.layers[1:], strict=True):
            scale, shift = film(asked)[which][..., None, None].chunk(2, dim=1)
            seen = functional.group_norm(layer(seen), _GROUPS)
            seen = functional.relu(torch.addcmul(shift, seen, 1.0 + scale))
        tokens: Tensor = self.point(key_points(seen))
        return tokens


class PixelsNetwork(TokenNetwork):
    """Network of the ``pixels`` family. A convolutional network finds key points in each view, which form one token.

    The words of the instruction scale and shift each channel (FiLM, Perez et al. 2018). The output of a channel is the
    mean position under its softmax over the image, together with its peak value (spatial softmax, Levine et al. 2016,
    "End-to-End Training of Deep Visuomotor Policies"). All views share the same convolutional network.
    """

    def open_eyes(self, width: int, vocabulary: Vocabulary) -> None:
        """Create the convolutional network and the encoder of its key points."""
        del vocabulary
        self.eyes = _Convolutions(width, len(self.recipe.eyes.windows))

    def see(self, shown: ShownBatch, words: Tensor, told: Tensor, which: Tensor) -> tuple[Tensor, Tensor]:
        """Return one token per view. All views exist, so the mask is True for every view."""
        if not isinstance(shown, PicturesBatch):
            raise TypeError("PixelsNetwork needs a PicturesBatch")
        batch, views = shown.pictures.shape[:2]
        asked = functional.gelu(self.eyes.asked(words)) * told[..., None]
        asked = asked.sum(dim=1) / told.sum(dim=1, keepdim=True).clamp(min=1)
        pictures = self._light(shown).flatten(0, 1).permute(0, 3, 1, 2)
        points = self.eyes(pictures, asked, which.repeat_interleave(views))
        return points.view(batch, views, -1) + self.eyes.view.weight, told.new_ones(batch, views)

    def _light(self, shown: PicturesBatch) -> Tensor:
        """Convert images to floats centered at zero.

        If requested, change the contrast and brightness of each sample randomly.
        """
        values = shown.pictures.to(torch.float32).mul_(1.0 / 64.0).sub_(2.0)
        if shown.light is not None:
            contrast, brightness = shown.light[:, :, None, None, None, None].unbind(dim=1)
            values = values.mul_(1.0 + contrast).add_(4.0 * brightness)
        return values


def channels_of(width: int) -> tuple[int, int, int, int]:
    """Return the number of channels of each convolutional layer, given the width of tokens."""
    sixth = max(_GROUPS, width // 6 // _GROUPS * _GROUPS)
    return sixth, 2 * sixth, 4 * sixth, 6 * sixth


def key_points(seen: Tensor) -> Tensor:
    """Return the mean position (x, y from -1 to 1) and the peak value of each channel of a feature map.

    Args:
        seen: Feature map (B, C, height, width).

    Returns:
        Tensor (B, 3 C) with all x, then all y, then all peak values.
    """
    batch, channels, height, width = seen.shape
    x, y = (torch.linspace(-1.0, 1.0, count, device=seen.device) for count in (width, height))
    flat = seen.flatten(2)
    weights = flat.softmax(dim=-1).view(batch, channels, height, width)
    places = [weights.sum(dim=2) @ x, weights.sum(dim=3) @ y]
    return torch.cat([*places, flat.amax(dim=-1)], dim=1)
