"""The differentiable glimpse policies for SB3, and their controls."""

from baselines.glimpse.anytime import EarlyExit, anytime
from baselines.glimpse.extractor import GlimpseExtractor
from baselines.glimpse.logger import GlimpseLogger
from baselines.glimpse.ppo import GlimpsePPO
from baselines.glimpse.saliency_extractor import SaliencyGlimpseExtractor
from baselines.glimpse.saliency_ppo import SaliencyGlimpseDQN, SaliencyGlimpsePPO

__all__ = [
    "EarlyExit",
    "GlimpseExtractor",
    "GlimpseLogger",
    "GlimpsePPO",
    "SaliencyGlimpseDQN",
    "SaliencyGlimpseExtractor",
    "SaliencyGlimpsePPO",
    "anytime",
]
