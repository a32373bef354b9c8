"""Parts of pushed objects followed in depth images: errors, honesty, occlusion, loss, time."""
