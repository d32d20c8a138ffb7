from .arrays import read_arrays as read_arrays, write_arrays as write_arrays
from .atomic import atomic_folder as atomic_folder, atomic_path as atomic_path
from .images import read_image as read_image
from .layouts import Layout as Layout
from .loading import ViewOrderWarning as ViewOrderWarning, load as load
from .maps import (
    Map as Map,
    read_map as read_map,
    write_map as write_map,
    write_normals as write_normals,
)
from .mosaics import (
    join_macpi as join_macpi,
    join_tiles as join_tiles,
    split_macpi as split_macpi,
    split_tiles as split_tiles,
)
from .naming import GridWarning as GridWarning
from .pfm import read_pfm as read_pfm, write_pfm as write_pfm
