"""The learners of A. Borji's thesis (2009): decision trees over *where to look*, grown from reward."""

from attn_tree.growth import Growth
from attn_tree.learner import QuasiStaticLearner
from attn_tree.q_learning import TableLearner
from attn_tree.rlvc import RLVC
from attn_tree.s_tree import STree

__all__ = ["RLVC", "Growth", "QuasiStaticLearner", "STree", "TableLearner"]
