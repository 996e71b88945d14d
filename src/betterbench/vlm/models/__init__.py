"""Vision-language models and what they are shown: resolutions of a picture, InternVL's tiles, models in the process.

- ``eyes``: the resolutions of the myopic ablation.
- ``tiles``: InternVL's division of a picture into tiles, and the number of tokens.
- ``intern_vl``: InternVL checkpoints in the Hugging Face format; needs the extra ``vlm``.
"""
