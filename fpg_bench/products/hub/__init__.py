"""Sharing of agents on the Hugging Face Hub: upload with a model card, and download with checks."""
