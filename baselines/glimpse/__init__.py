"""The differentiable glimpse policies for SB3, and their controls."""

from baselines.glimpse.anytime import EarlyExit, anytime
from baselines.glimpse.extractor import GlimpseExtractor
from baselines.glimpse.hard_gaze import Gaze, GazePPO, GazeWrapper
from baselines.glimpse.logger import GlimpseLogger
from baselines.glimpse.ppo import GlimpsePPO
from baselines.glimpse.ram import RAM
from baselines.glimpse.saliency_extractor import SaliencyGlimpseExtractor
from baselines.glimpse.saliency_ppo import SaliencyGlimpseDQN, SaliencyGlimpsePPO

__all__ = [
    "RAM",
    "EarlyExit",
    "Gaze",
    "GazePPO",
    "GazeWrapper",
    "GlimpseExtractor",
    "GlimpseLogger",
    "GlimpsePPO",
    "SaliencyGlimpseDQN",
    "SaliencyGlimpseExtractor",
    "SaliencyGlimpsePPO",
    "anytime",
]
