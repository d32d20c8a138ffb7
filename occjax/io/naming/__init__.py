"""Assignment of the files of a folder to views, by their names.

:mod:`~occjax.io.naming.patterns` turns file name patterns into regular expressions,
:mod:`~occjax.io.naming.fitting_patterns` finds the pattern of unknown names,
:mod:`~occjax.io.naming.arrangement` arranges matched names as a grid, and
:mod:`~occjax.io.naming.views` combines them.
"""

from occjax.io.naming.arrangement import GridWarning, NamedViews, first_few
from occjax.io.naming.views import find_views

__all__ = ["GridWarning", "NamedViews", "find_views", "first_few"]
