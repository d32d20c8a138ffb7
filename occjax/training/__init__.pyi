from .config import (
    DataConfig as DataConfig,
    LossConfig as LossConfig,
    OptimiserConfig as OptimiserConfig,
    RunConfig as RunConfig,
    TrainConfig as TrainConfig,
)
from .data import (
    make_source as make_source,
)
from .logging import (
    read_log as read_log,
)
from .loop import (
    Trained as Trained,
    train as train,
)
from .occcasnet import (
    cascade_loss as cascade_loss,
)
from .optimiser import (
    learning_rate as learning_rate,
    make_optimiser as make_optimiser,
)
from .proposal import (
    selection_errors as selection_errors,
)
from .recipes import (
    RECIPES as RECIPES,
    Recipe as Recipe,
    recipe as recipe,
)
from .step import (
    TrainState as TrainState,
    init_state as init_state,
    train_step as train_step,
)
from .tasks import (
    TrainingTask as TrainingTask,
    task_of as task_of,
)
from .validation import (
    scenes_from_batch as scenes_from_batch,
    scenes_from_folders as scenes_from_folders,
    validate as validate,
)
