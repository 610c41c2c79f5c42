"""What `compare` takes from here; see `arguments`."""

from .arguments import check_forcing as check_forcing
