"""The vehicle as rigid bodies with contacts, in MuJoCo."""
