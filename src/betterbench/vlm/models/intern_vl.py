"""InternVL checkpoints in the Hugging Face format, which run in this process.

Only the image processor and the tokenizer of a checkpoint are used. The combined processor of transformers is not used,
because it needs torchvision, and the wheels of torchvision do not match the CPU build of PyTorch. Instead, this module
replaces the placeholder of each image by one token per visual feature.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from betterbench.errors import InvalidInputError, ModelError, one_line, require_between
from betterbench.installation import missing_extra
from betterbench.vlm.models.tiles import MOST_TILES, TILES_ALLOWED
from betterbench.vqa.llm.chat import PICTURE

if TYPE_CHECKING:
    import torch
    from transformers import PretrainedConfig

_ARCHITECTURE = "InternVLForConditionalGeneration"
_SERVE = "Serve other models with vLLM or SGLang, and give the address as URL#MODEL"


@dataclass(frozen=True, slots=True)
class Sight:
    """Images of a request after preprocessing for the vision transformer.

    Attributes:
        pixels: Normalized pixels of all tiles, (tiles, 3, side, side).
        tiles: Number of tiles of each image, including the thumbnail.
        tokens: Number of language model tokens for each tile.
    """

    pixels: torch.Tensor
    tiles: tuple[int, ...]
    tokens: int


class InternVl:
    """InternVL checkpoint as a model. It always generates the most likely token, without sampling.

    Attributes:
        name: Folder name of the checkpoint, followed by the number of tiles and their side.
    """

    def __init__(
        self,
        folder: Path,
        *,
        most_tiles: int = MOST_TILES,
        side: int | None = None,
        max_tokens: int = 256,
        device: str | None = None,
    ) -> None:
        """Load the weights of a checkpoint.

        Args:
            folder: Folder of the checkpoint, with config.json, the tokenizer and the weights.
            most_tiles: Maximum number of tiles per image, not counting the thumbnail. With a single tile, the image is
                squashed to a square.
            side: Side of a tile [pixel]. If None, it is that of the checkpoint (448). With 224, a tile has 64 tokens
                instead of 256, and the position embeddings are interpolated.
            max_tokens: Maximum length of an answer [tokens].
            device: PyTorch device. If None, the GPU is used if there is one, and otherwise the CPU.

        Raises:
            MissingDependencyError: If torch or transformers is not installed.
            InvalidInputError: If the folder does not contain an InternVL checkpoint that transformers can load.
        """
        _require_libraries()
        import torch  # noqa: PLC0415 - an optional part
        import transformers  # noqa: PLC0415 - an optional part
        from safetensors import SafetensorError  # noqa: PLC0415 - an optional part

        config = _read_config(folder)
        require_between("max-tiles", most_tiles, 1, TILES_ALLOWED)
        self._most_tiles, self._max_tokens = most_tiles, max_tokens
        self._device = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
        try:
            self._images = transformers.AutoImageProcessor.from_pretrained(folder, local_files_only=True)
            self._tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
            model = transformers.AutoModelForImageTextToText.from_pretrained(
                folder, local_files_only=True, dtype="auto" if self._device.type == "cuda" else torch.float32
            )
        except ImportError as error:  # for example, a torchvision built for another torch version
            problem = f"transformers cannot load it, because an import fails ({one_line(error, most=200)})"
            cure = "Install matching versions of torch, torchvision and transformers, or uninstall torchvision"
            raise InvalidInputError(str(folder), problem, cure) from error
        except (OSError, ValueError, KeyError, RuntimeError, SafetensorError) as error:
            problem = f"cannot be loaded as a checkpoint ({one_line(error, most=200)})"
            raise InvalidInputError(str(folder), problem, "Download all files of the checkpoint again") from error
        if not getattr(self._tokenizer, "chat_template", None):
            raise InvalidInputError(str(folder), "it has no chat template", "Download chat_template.jinja as well")
        self._model = model.to(self._device).eval()
        vision = config.vision_config
        self._patch, self._side = int(vision.patch_size[0]), side or int(vision.image_size[0])
        self._shuffle = float(config.downsample_ratio)
        tiles = "1 tile" if most_tiles == 1 else f"up to {most_tiles} tiles"
        self.name = f"{folder.resolve().name} ({tiles} of {self._side} pixels)"
        self._token = self._tokenizer.convert_ids_to_tokens(config.image_token_id)

    def answer(self, prompt: str, pictures: Sequence[bytes]) -> str:
        """Return the model's answer to a prompt about images.

        Args:
            prompt: The prompt. Each ``<image>`` in it marks the position of an image. Without such marks, the images
                come first.
            pictures: Content of PNG, JPEG, GIF or WebP files.

        Raises:
            ModelError: If the model fails, for example because the GPU has too little memory.
        """
        import torch  # noqa: PLC0415 - an optional part

        text, sight = self.request(prompt, pictures)
        inputs = self._tokenizer(text, return_tensors="pt", add_special_tokens=False).to(self._device)
        if sight is not None:
            inputs["pixel_values"] = sight.pixels.to(self._device, self._model.dtype)
        try:
            with torch.inference_mode():
                ids = self._model.generate(**inputs, max_new_tokens=self._max_tokens, do_sample=False)
        except RuntimeError as error:  # includes torch.OutOfMemoryError
            cure = "Use a smaller --max-tiles, or serve the model and pass its address"
            raise ModelError(f"{self.name}: the model failed ({one_line(error, most=200)}). {cure}.") from error
        answer = self._tokenizer.decode(ids[0, inputs["input_ids"].shape[1] :], skip_special_tokens=True)
        return str(answer)

    def request(self, prompt: str, pictures: Sequence[bytes]) -> tuple[str, Sight | None]:
        """Return the input text for the language model, and the images for the vision transformer.

        None is returned instead of the images if the request has no pictures.
        """
        sight = self._sight(pictures) if pictures else None
        parts = prompt.split(PICTURE)
        if not pictures or len(parts) != len(pictures) + 1:
            parts = [*[""] * len(pictures), prompt]
        content: list[dict[str, str]] = []
        for i, part in enumerate(parts):
            content += [{"type": "text", "text": part.replace(self._token, "")}] if part else []
            content += [{"type": "image"}] if i < len(pictures) else []
        text = self._tokenizer.apply_chat_template(
            [{"role": "user", "content": content}], add_generation_prompt=True, tokenize=False
        )
        tiles = iter(sight.tiles if sight else ())
        expanded = re.sub(re.escape(self._token), lambda _: self._placeholder(next(tiles), sight), str(text))
        return expanded, sight

    def _placeholder(self, tiles: int, sight: Sight | None) -> str:
        tokens = sight.tokens if sight else 0
        return f"<img>{self._token * (tokens * tiles)}</img>"

    def _sight(self, pictures: Sequence[bytes]) -> Sight:
        import torch  # noqa: PLC0415 - an optional part

        pixels, tiles = [], []
        for picture in pictures:
            with Image.open(io.BytesIO(picture)) as opened:
                image = opened.convert("RGB")
            made = self._images(
                image,
                crop_to_patches=self._most_tiles > 1,
                min_patches=1,
                max_patches=self._most_tiles,
                size={"height": self._side, "width": self._side},
                return_tensors="pt",
            )
            pixels.append(made["pixel_values"])
            tiles.append(int(made["pixel_values"].shape[0]))
        return Sight(torch.cat(pixels), tuple(tiles), int(self._side // self._patch * self._shuffle) ** 2)


def _require_libraries() -> None:
    try:
        import torch  # noqa: F401, PLC0415 - an optional part
        import transformers  # noqa: F401, PLC0415 - an optional part
    except ImportError as error:
        problem = f"Models in this process need torch and transformers, which are not installed ({error})"
        raise missing_extra(problem, "vlm") from error


def _read_config(folder: Path) -> PretrainedConfig:
    """Read the configuration of an InternVL checkpoint.

    Raises InvalidInputError if the folder does not contain such a checkpoint.
    """
    import transformers  # noqa: PLC0415 - an optional part

    cure = f"Pass the folder of an InternVL checkpoint in the Hugging Face format (its name ends in -HF). {_SERVE}"
    if not (folder / "config.json").is_file():
        raise InvalidInputError(str(folder), "it contains no config.json", cure)
    try:
        config = transformers.AutoConfig.from_pretrained(folder, local_files_only=True)
    except (OSError, ValueError, KeyError) as error:
        problem = f"its config.json cannot be read ({one_line(error, most=200)})"
        raise InvalidInputError(str(folder), problem, cure) from error
    named = list(getattr(config, "architectures", None) or [type(config).__name__])
    if _ARCHITECTURE not in named:
        raise InvalidInputError(
            str(folder), f"it is a checkpoint of {', '.join(named)}, expected {_ARCHITECTURE}", cure
        )
    return config
