"""The gel as a solid: a bonded elastic layer and what is pressed into it. Knows neither pictures nor fits."""
