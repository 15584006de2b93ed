"""The learners of A. Borji's thesis (2009): decision trees over *where to look*, grown from reward."""
