"""The live page: a local web server that decides again, and follows a drive that is under way.

The page is that of `sandra.view.report`; what it adds is a form and an address to send it to. The
server answers to this machine alone, and only to the page that it has served (`guard`).
"""

from sandra.live.offer import Offer
from sandra.live.server import application

__all__ = ["Offer", "application"]
