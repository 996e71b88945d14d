"""Vision-language models and their images: resolutions, InternVL's tiles, and models in this process.

- ``eyes``: the resolutions of the myopic ablation.
- ``tiles``: InternVL's image tiling, and its number of tokens.
- ``intern_vl``: InternVL checkpoints in the Hugging Face format; needs the extra ``vlm``.
- ``kind``: kinds of models, told apart by their address; ``endpoint`` and ``hugging_face`` are two of them.
"""
