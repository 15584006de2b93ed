"""Everything that the thesis's methods are measured against."""

from baselines.bank_extractor import BankExtractor
from baselines.c45 import C45
from baselines.glimpse import (
    RAM,
    EarlyExit,
    GazePPO,
    GazeWrapper,
    GlimpseExtractor,
    GlimpseLogger,
    GlimpsePPO,
    SaliencyGlimpseDQN,
    SaliencyGlimpseExtractor,
    SaliencyGlimpsePPO,
)
from baselines.macs import count_macs
from baselines.nature_cnn import NatureDQN, NatureExtractor, NaturePPO
from baselines.nvt import NVT, learn_nvt
from baselines.pixel_tree import PixelTree
from baselines.proto_object import ProtoObject, proto_object
from baselines.random_agent import RandomAgent
from baselines.rival import Rival
from baselines.spectral_residual import spectral_residual
from baselines.tabular import TabularQ, ThumbnailQ
from baselines.teacher import AskTeacher, fidelity
from baselines.template import TemplateMatcher, learn_template
from baselines.vocus import VOCUS, learn_vocus

__all__ = [
    "C45",
    "NVT",
    "RAM",
    "VOCUS",
    "AskTeacher",
    "BankExtractor",
    "EarlyExit",
    "GazePPO",
    "GazeWrapper",
    "GlimpseExtractor",
    "GlimpseLogger",
    "GlimpsePPO",
    "NatureDQN",
    "NatureExtractor",
    "NaturePPO",
    "PixelTree",
    "ProtoObject",
    "RandomAgent",
    "Rival",
    "SaliencyGlimpseDQN",
    "SaliencyGlimpseExtractor",
    "SaliencyGlimpsePPO",
    "TabularQ",
    "TemplateMatcher",
    "ThumbnailQ",
    "count_macs",
    "fidelity",
    "learn_nvt",
    "learn_template",
    "learn_vocus",
    "proto_object",
    "spectral_residual",
]
