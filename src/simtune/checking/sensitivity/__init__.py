"""What each parameter changes in pictures, motion and readings; and how well it could be known."""
