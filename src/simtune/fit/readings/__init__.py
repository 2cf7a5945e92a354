"""The motion in joint readings: open-loop replay, and fits by its errors."""
