"""Vision-language models and their images: image resolutions, InternVL's tiles, and models that run in this process.

- ``eyes``: the resolutions at which a model is shown images, as in the paper's ablation with a "myopic" model.
- ``tiles``: InternVL's division of an image into tiles, and the resulting number of tokens.
- ``intern_vl``: InternVL checkpoints in the Hugging Face format. This needs the extra ``vlm``.
- ``kind``: kinds of models, which are recognized by their address. ``endpoint`` and ``hugging_face`` are two of them.
"""
