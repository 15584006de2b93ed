"""The differentiable glimpse policy for SB3, and its controls."""

from baselines.glimpse.extractor import GlimpseExtractor
from baselines.glimpse.logger import GlimpseLogger
from baselines.glimpse.ppo import GlimpsePPO

__all__ = ["GlimpseExtractor", "GlimpseLogger", "GlimpsePPO"]
