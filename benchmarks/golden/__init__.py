"""What every verb answers on small recordings, held against what it answered before."""
