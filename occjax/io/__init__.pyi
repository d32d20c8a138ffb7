from .arrays import read_arrays as read_arrays
from .arrays import write_arrays as write_arrays
from .atomic import atomic_folder as atomic_folder
from .atomic import atomic_path as atomic_path
from .images import read_image as read_image
from .layouts import Layout as Layout
from .loading import ViewOrderWarning as ViewOrderWarning
from .loading import load as load
from .maps import (
    Map as Map,
)
from .maps import (
    read_map as read_map,
)
from .maps import (
    write_map as write_map,
)
from .maps import (
    write_normals as write_normals,
)
from .mosaics import (
    join_macpi as join_macpi,
)
from .mosaics import (
    join_tiles as join_tiles,
)
from .mosaics import (
    split_macpi as split_macpi,
)
from .mosaics import (
    split_tiles as split_tiles,
)
from .naming import GridWarning as GridWarning
from .pfm import read_pfm as read_pfm
from .pfm import write_pfm as write_pfm
