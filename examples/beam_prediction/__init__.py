"""Multimodal beam prediction: `python -m examples.beam_prediction --help`; `docs/beam-prediction.md`."""
