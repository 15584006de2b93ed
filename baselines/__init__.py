"""Everything that the thesis's methods are measured against."""

from baselines.bank_extractor import BankExtractor
from baselines.glimpse import GlimpseExtractor, GlimpseLogger, GlimpsePPO
from baselines.macs import count_macs
from baselines.nature_cnn import NatureDQN, NatureExtractor, NaturePPO
from baselines.pixel_tree import PixelTree
from baselines.random_agent import RandomAgent
from baselines.tabular import TabularQ, ThumbnailQ

__all__ = [
    "BankExtractor",
    "GlimpseExtractor",
    "GlimpseLogger",
    "GlimpsePPO",
    "NatureDQN",
    "NatureExtractor",
    "NaturePPO",
    "PixelTree",
    "RandomAgent",
    "TabularQ",
    "ThumbnailQ",
    "count_macs",
]
