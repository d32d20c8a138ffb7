from .conversion import (
    PointCloud as PointCloud,
    convert_map as convert_map,
    flying_pixels as flying_pixels,
    normals as normals,
    point_cloud as point_cloud,
    write_points as write_points,
)
from .outputs import (
    OutputOptions as OutputOptions,
    Outputs as Outputs,
    write_outputs as write_outputs,
)
from .reading import read_estimate as read_estimate
