"""Read city models: CityJSON and CityGML."""
