"""What a long run is watched for: compilations, memory, and whether answers stay the same."""
