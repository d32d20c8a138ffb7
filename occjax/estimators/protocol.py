"""The protocol that every estimator implements, its input and output, and a base class."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from occjax.errors import InputError
from occjax.lightfield import LightField
from occjax.models.registry import ModelConfig

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from occjax.results.outputs import Outputs
    from occjax.viewer import Viewer
    from occjax.viz.plots import Quantity

DisparityRange = tuple[float, float]
"""``(minimum, maximum)``, in pixels per view step."""


class ModelInputs(NamedTuple):
    """Input of an estimator's pure function.

    Attributes:
        variables: Weights; the same for every light field.
        views: Views as the estimator needs them.
        arguments: Further arguments of ``run``, in its order: arrays that depend on the light
            field, for instance candidates.
        disparity_range: Range that is searched.
        notes: Messages for the user.
        view_indices: Indices of the views, row by row in the light field; None for all views.
    """

    variables: Any
    views: np.ndarray
    arguments: tuple[Any, ...]
    disparity_range: DisparityRange
    notes: tuple[str, ...] = ()
    view_indices: np.ndarray | None = None


class ViewMaps(NamedTuple):
    """Maps of all views; NaN and 0 for views that cannot be used.

    Attributes:
        disparity: ``[V, U, H, W]`` float32, pixels per view step.
        confidence: ``[V, U, H, W]`` float32 in [0, 1], of the estimator.
        consistency: ``[V, U, H, W]`` float32 in [0, 1], a second confidence: the fraction of the
            neighbouring views that confirm the disparity, among those that confirm or contradict
            it (:func:`occjax.ops.cross_view_counts`).
        agreeing: ``[V, U, H, W]`` int32 number of neighbouring views that confirm it.
        filled: ``[V, U, H, W]`` bool, pixels whose disparity is taken from other views.
        offsets: ``[V, U, 2]`` float32 offset ``(row, column)`` of each view from the centre view,
            in view steps, as declared or measured.
        tolerance: Largest difference of disparities that confirm each other, pixels per view step.
    """

    disparity: np.ndarray
    confidence: np.ndarray
    consistency: np.ndarray
    agreeing: np.ndarray
    filled: np.ndarray
    offsets: np.ndarray
    tolerance: float


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """Disparity map of the centre view, and of all views if requested.

    Attributes:
        disparity: ``[H, W]`` float32, pixels per view step.
        confidence: ``[H, W]`` float32 in [0, 1]; 1 is certain. One minus the normalised entropy of
            the candidates' probabilities, reduced near depth edges; for a cascade that of the least
            certain stage; for a selection the probability of all proposals close to the selected
            one. Values of different models or grids cannot be compared.
        standard_deviation: ``[H, W]`` float32, standard deviation of the last stage's
            probabilities, pixels per view step.
        disparity_range: ``(minimum, maximum)`` that was searched.
        model: Name of the estimator.
        weights: Name of the weights, if the estimator has any.
        coarse: ``[H, W]`` float32 disparity of the first stage, if there is more than one.
        stages: ``[H, W]`` float32 disparity after each stage; the last one is ``disparity``.
        occlusion: ``[V, U, H, W]`` float32 occlusion maps in [0, 1] (OccCasNet, eq. 5), 1 where a
            view does not see the point; None unless requested or computed by the model.
        notes: Messages for the user, such as a cropped grid or the measured range.
        seconds: Wall-clock seconds of each phase, e.g. ``{"compile": 3.1, "run": 0.4}``.
        light_field: The light field that was estimated; :meth:`load` returns the part of it that is
            stored.
        views: Maps of all views, if they were requested.
    """

    disparity: np.ndarray
    confidence: np.ndarray
    standard_deviation: np.ndarray
    disparity_range: DisparityRange
    model: str
    weights: str | None = None
    coarse: np.ndarray | None = None
    stages: tuple[np.ndarray, ...] = ()
    occlusion: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    light_field: LightField | None = None
    views: ViewMaps | None = None

    def save(
        self,
        folder: str | Path,
        *,
        what: str | tuple[str, ...] = ("maps", "pictures", "cloud"),
        min_confidence: float | None = None,
    ) -> Outputs:
        """Write the estimate to a folder, as ``occjax estimate`` does.

        Args:
            folder: Folder to write; see :func:`occjax.results.outputs.write_outputs`.
            what: Groups of files: names of :data:`occjax.results.groups.GROUPS`, or ``"all"``.
            min_confidence: Confidence in [0, 1] below which a pixel has no point in the cloud.

        Returns:
            The files that were written, with notes and scores.

        Raises:
            InputError: If the estimate has no light field, ``what`` is empty or has an unknown
                name, or the folder cannot be written.

        Example:
            >>> import tempfile
            >>> flat = np.ones((8, 8), np.float32)
            >>> wall = LightField(np.zeros((3, 3, 8, 8), np.uint8))
            >>> estimate = Estimate(flat, flat, flat, (0.0, 2.0), "mine", light_field=wall)
            >>> outputs = estimate.save(tempfile.mkdtemp(), what="maps")
            >>> Estimate.load(outputs.folder).disparity[0, 0].item()
            1.0
        """
        from occjax.results.outputs import output_options, write_outputs

        if self.light_field is None:
            raise InputError(
                "the estimate has no light field; set it with dataclasses.replace(estimate, "
                "light_field=light_field)"
            )
        return write_outputs(self, self.light_field, folder, output_options(what, min_confidence))

    @classmethod
    def load(cls, folder: str | Path, *, light_field: LightField | None = None) -> Estimate:
        """Read an estimate from a folder that :meth:`save` or ``occjax estimate`` has written.

        Disparity, confidence, standard deviation and stages are exact. Occlusion maps are stored in
        half precision.

        Args:
            folder: The folder; it must contain the group of files ``maps``.
            light_field: The light field that was estimated. Without it, the light field of the
                estimate has the stored grid, calibration and ground truth, and the centre view in 8
                bits; no other view is usable. It is None if an older version wrote the folder.

        Returns:
            The estimate. What was not saved is None; an unknown standard deviation is NaN.

        Raises:
            InputError: If the folder has no disparity map or no summary, a file is damaged, or the
                light field has another size or is around another view.
        """
        from occjax.results.reading import read_estimate

        return read_estimate(folder, light_field)

    def plot(self, quantity: Quantity = "disparity", *, axes: Axes | None = None) -> Axes:
        """Draw a map with its colour bar with Matplotlib.

        Args:
            quantity: ``"disparity"``, ``"confidence"``, or ``"error"``, which needs ground truth.
            axes: Axes to draw into; by default those of a new figure.

        Returns:
            The axes.

        Raises:
            InputError: If the quantity is unknown, or there is no ground truth for the error.

        Example:
            >>> flat = np.ones((8, 8), np.float32)
            >>> Estimate(flat, flat, flat, (0.0, 2.0), "mine").plot("confidence").get_title()
            'Confidence'
        """
        from occjax.viz.plots import plot_estimate

        return plot_estimate(self, quantity, axes)

    def __repr__(self) -> str:
        """Describe the estimate in two lines."""
        from occjax.viz.descriptions import describe_estimate

        return str(describe_estimate(self))

    def _repr_html_(self) -> str:
        """Return the disparity map in colours and a table, which notebooks show."""
        from occjax.viz.descriptions import describe_estimate
        from occjax.viz.pictures import disparity_picture

        picture = disparity_picture(self.disparity, confidence=self.confidence)
        return describe_estimate(self).html(picture)

    def view(
        self,
        light_field: LightField | None = None,
        *,
        others: tuple[Estimate, ...] = (),
        host: str = "127.0.0.1",
        port: int | None = None,
        open_browser: bool = True,
    ) -> Viewer:
        """Open the estimate in the browser (extra ``view``), see :mod:`occjax.viewer`.

        Args:
            light_field: The light field that was estimated; without it, the page has neither views
                nor metric depth nor errors.
            others: Other estimates of the same light field, to compare with.
            host: Address to listen at; by default only this computer can reach the page.
            port: Port to listen at; None for a free one.
            open_browser: Whether to open the page in the user's browser.

        Returns:
            The viewer, which runs in the background. In a script, call its ``wait()``.

        Raises:
            InputError: If viser is missing, the port is taken, or the maps do not fit the views.
        """
        from occjax.viewer.opening import open_viewer, scene_of

        scene = scene_of((self, *others), light_field)
        return open_viewer(scene, host=host, port=port, open_browser=open_browser)


@runtime_checkable
class Estimator(Protocol):
    """An estimator of disparity, in three steps.

    :func:`occjax.estimators.run_estimator` calls ``prepare``, compiles ``run`` once per shape of
    its input, and passes the result to ``finish``. Estimators are hashable. Estimators that compare
    equal share compiled programs, so a frozen dataclass excludes its variables from the comparison.
    """

    def __hash__(self) -> int: ...

    @property
    def name(self) -> str:
        """Name of the model."""
        ...

    def prepare(
        self, light_field: LightField, disparity_range: DisparityRange | None
    ) -> ModelInputs:
        """Convert a light field to arrays.

        Args:
            light_field: Light field.
            disparity_range: Range to search; None to use that of the light field or to measure it.

        Raises:
            InputError: If the light field does not fit the model.
        """
        ...

    def run(self, variables: Any, views: Any, *arguments: Any) -> Any:
        """Compute the result from the inputs; a pure function, compiled by :func:`jax.jit`."""
        ...

    def finish(self, inputs: ModelInputs, outputs: Any) -> Estimate:
        """Convert the result, as NumPy arrays, to an estimate."""
        ...


@dataclass(frozen=True)
class ModelEstimator:
    """Base class of the estimators of a model.

    Attributes:
        name: Name of the model.
        config: Configuration of the model.
        variables: Variables of the model, if it needs any.
        weights: Name of the weights, or None.
        precision: Type of the convolutions.
    """

    name: str
    config: ModelConfig
    variables: dict = field(default_factory=dict, compare=False)
    weights: str | None = field(default=None, compare=False)
    precision: str = "float32"

    def finish(self, inputs: ModelInputs, outputs: dict[str, Any]) -> Estimate:
        """Add names and notes to the maps."""
        return Estimate(
            **outputs,
            disparity_range=inputs.disparity_range,
            model=self.name,
            weights=self.weights,
            notes=inputs.notes,
        )
