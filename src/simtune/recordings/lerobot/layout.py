"""Names of the LeRobotDataset v3.0 layout, for its reader and its writer."""

CODEBASE_VERSION = "v3.0"
INFO_PATH = "meta/info.json"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
IMAGES_PREFIX = "observation.images."
