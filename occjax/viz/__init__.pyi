from .canvas import save as save
from .figures import (
    comparison_figure as comparison_figure,
    confidence_figure as confidence_figure,
    depth_figure as depth_figure,
    disparity_figure as disparity_figure,
    error_figure as error_figure,
    occlusion_figure as occlusion_figure,
)
from .pictures import (
    confidence_picture as confidence_picture,
    disparity_picture as disparity_picture,
    error_picture as error_picture,
    save_picture as save_picture,
    view_picture as view_picture,
)
