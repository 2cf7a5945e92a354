"""Search by joint readings alone; also before videos are looked at."""
