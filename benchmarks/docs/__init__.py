"""Do all commands and snippets of README and docs run as they stand?"""
