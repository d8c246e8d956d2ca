"""Multimodal beam prediction: `python -m examples.beam_prediction --help`; `docs/guides/beam-prediction.md`."""
