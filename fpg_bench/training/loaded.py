"""Modules that every training loads; processes forked from one that has imported it begin at once."""

from __future__ import annotations

import torch

import fpg_bench.training.train  # noqa: F401

torch.optim.Adam([torch.zeros(1)])  # the first one imports half of torch
