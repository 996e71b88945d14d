"""Vision-language models and their images: resolutions, InternVL's tiles, and models in this process.

- ``eyes``: the image resolutions of the paper's ablation with "myopic" eyes.
- ``tiles``: InternVL's image tiling, and the resulting number of tokens.
- ``intern_vl``: InternVL checkpoints in the Hugging Face format; needs the extra ``vlm``.
- ``kind``: kinds of models, recognized by their address; ``endpoint`` and ``hugging_face`` are two of them.
"""
