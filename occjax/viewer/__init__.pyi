from .config import ViewerConfig as ViewerConfig
from .opening import open_viewer as open_viewer, read_scene as read_scene, scene_of as scene_of
from .scene import ViewedResult as ViewedResult, ViewedScene as ViewedScene
from .server import Viewer as Viewer
