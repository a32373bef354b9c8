"""Recordings replayed onto topics at their own pace, and the nodes that live on them."""
