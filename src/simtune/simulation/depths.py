"""What a camera sees and how far that is, pixel by pixel: no colours and no light."""

import copy

import mujoco
import mujoco_warp
import numpy as np
import warp

from simtune.simulation.raycaster import assign, init_warp

_CHUNK = 16  # pictures a launch
_DRAWN_GROUP, _HIDDEN_GROUP = 0, 5


class Depths:
    """Draws geoms by mujoco_warp's ray caster, with poses of geoms and camera as they are given.

    Flexes are not there.
    """

    def __init__(
        self, model: mujoco.MjModel, camera: str, size: tuple[int, int], shown: np.ndarray
    ):
        """`size`: (height, width) of pictures; `shown`: (ngeom,) bool, all others are not there."""
        init_warp()
        self.size, model = size, copy.copy(model)
        model.geom_group[:] = np.where(shown, _DRAWN_GROUP, _HIDDEN_GROUP)
        model.geom_rgba[shown, 3], model.geom_matid[:] = 1, -1  # nothing is seen through
        self._camera = model.camera(camera).id
        self._fovy, self._num_cameras = model.cam_fovy.astype(np.float32), model.ncam
        self._has_flexes = model.nflex > 0
        self._model = mujoco_warp.put_model(model)
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
        """(n, H, W) geoms, −1 where nothing is hit, and m along the camera's axis, 0 there.

        Of geoms at (n, ngeom, 3) `places`, turned by (n, ngeom, 3, 3), before cameras at (n, 3),
        turned by (n, 3, 3).
        """
        self._fovy[self._camera] = fovy_deg
        self._model.cam_fovy = warp.array(np.tile(self._fovy, (_CHUNK, 1)), dtype=float)
        depths = np.empty((len(places), *self.size), np.float32)
        geoms = np.empty(depths.shape, np.int32)
        for start in range(0, len(places), _CHUNK):
            n = min(_CHUNK, len(places) - start)
            chunk = start + np.arange(_CHUNK) % n
            assign(self._data.geom_xpos, places[chunk])
            assign(self._data.geom_xmat, turns[chunk])
            assign(self._data.cam_xpos, self._of_camera(camera_places[chunk]))
            assign(self._data.cam_xmat, self._of_camera(camera_turns[chunk]))
            # Flexes' search trees are of a fixed number of worlds; no vertex of theirs has a place
            self._data.nworld = _CHUNK if self._has_flexes else n
            mujoco_warp.refit_bvh(self._model, self._data, self._context)
            mujoco_warp.render(self._model, self._data, self._context)
            shape, into = (n, *self.size), slice(start, start + n)
            depths[into] = self._context.depth_data.numpy()[:n].reshape(shape)
            geoms[into] = self._context.seg_data.numpy()[:n, :, 0].reshape(shape)
        return geoms, depths

    def _of_camera(self, values: np.ndarray) -> np.ndarray:
        """(n, …) of this camera, among (n, ncam, …)."""
        every = np.zeros((len(values), self._num_cameras, *values.shape[1:]))
        every[:, self._camera] = values
        return every
