"""Hidden-effect benchmark: does the diagnosis find what recordings hide, and say when it cannot?"""
