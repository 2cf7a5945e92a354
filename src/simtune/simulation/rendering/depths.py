"""Geoms and depths before a camera, per pixel, without colours and light."""

import copy

import mujoco
import mujoco_warp
import numpy as np
import warp

from simtune.simulation.rendering.warp_context import assign, init_warp
from simtune.simulation.rendering.warp_model import put_model

_CHUNK = 16  # pictures per launch
_DRAWN_GROUP, _HIDDEN_GROUP = 0, 5


class Depths:
    """Draws geoms with mujoco_warp's ray caster, at given poses of geoms and camera.

    Flexes are not drawn.
    """

    def __init__(
        self, model: mujoco.MjModel, camera: str, size: tuple[int, int], shown: np.ndarray
    ):
        """`size`: (height, width) of pictures; `shown`: (ngeom,) bool, the geoms to draw."""
        init_warp()
        self.size, model = size, copy.copy(model)
        model.geom_group[:] = np.where(shown, _DRAWN_GROUP, _HIDDEN_GROUP)
        model.geom_rgba[shown, 3], model.geom_matid[:] = 1, -1  # everything is opaque
        self._camera = model.camera(camera).id
        self._fovy, self._num_cameras = model.cam_fovy.astype(np.float32), model.ncam
        self._has_flexes = model.nflex > 0
        self._model = put_model(model)
        self._data = mujoco_warp.make_data(model, nworld=_CHUNK)
        self._context = mujoco_warp.create_render_context(
            model,
            nworld=_CHUNK,
            cam_res=(size[1], size[0]),
            cam_active=[camera],
            enabled_geom_groups=[_DRAWN_GROUP],
            render_rgb=False,
            render_depth=True,
            render_seg=True,
            use_textures=False,
            use_precomputed_rays=False,  # the field of view may change
        )

    def draw(
        self,
        places: np.ndarray,
        turns: np.ndarray,
        camera_places: np.ndarray,
        camera_turns: np.ndarray,
        fovy_deg: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n, H, W) geoms, −1 for none, and depths in m along the camera's axis, 0 for none.

        Of geoms at (n, ngeom, 3) `places` with (n, ngeom, 3, 3) rotations `turns`, before cameras
        at (n, 3) with (n, 3, 3) rotations.
        """
        warp.set_device("cpu")  # others may draw elsewhere
        self._fovy[self._camera] = fovy_deg
        self._model.cam_fovy = warp.array(np.tile(self._fovy, (_CHUNK, 1)), dtype=float)
        depths = np.empty((len(places), *self.size), np.float32)
        geoms = np.empty(depths.shape, np.int32)
        for start in range(0, len(places), _CHUNK):
            n = min(_CHUNK, len(places) - start)
            chunk = slice(start, start + n)
            assign(self._data.geom_xpos, places[chunk])
            assign(self._data.geom_xmat, turns[chunk])
            assign(self._data.cam_xpos, self._of_camera(camera_places[chunk]))
            assign(self._data.cam_xmat, self._of_camera(camera_turns[chunk]))
            # Flexes' search trees have a fixed number of worlds; vertices have no positions here
            self._data.nworld = _CHUNK if self._has_flexes else n
            mujoco_warp.refit_bvh(self._model, self._data, self._context)
            mujoco_warp.render(self._model, self._data, self._context)
            shape = (n, *self.size)
            depths[chunk] = self._context.depth_data.numpy()[:n].reshape(shape)
            geoms[chunk] = self._context.seg_data.numpy()[:n, :, 0].reshape(shape)
        return geoms, depths

    def _of_camera(self, values: np.ndarray) -> np.ndarray:
        """(n, …) of this camera, among (n, ncam, …)."""
        by_camera = np.zeros((len(values), self._num_cameras, *values.shape[1:]))
        by_camera[:, self._camera] = values
        return by_camera
