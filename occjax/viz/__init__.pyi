from .canvas import save as save
from .figures import (
    comparison_figure as comparison_figure,
)
from .figures import (
    confidence_figure as confidence_figure,
)
from .figures import (
    depth_figure as depth_figure,
)
from .figures import (
    disparity_figure as disparity_figure,
)
from .figures import (
    error_figure as error_figure,
)
from .figures import (
    occlusion_figure as occlusion_figure,
)
from .pictures import (
    confidence_picture as confidence_picture,
)
from .pictures import (
    disparity_picture as disparity_picture,
)
from .pictures import (
    error_picture as error_picture,
)
from .pictures import (
    save_picture as save_picture,
)
