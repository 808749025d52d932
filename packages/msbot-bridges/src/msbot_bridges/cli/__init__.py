"""Commands: `msbot bridge`"""
