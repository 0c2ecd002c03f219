"""Flights: from a contact sensor, or from a track as one motion of rest, contact and parabolas."""

from .beyond import Ring as Ring
from .contact import contact_flights as contact_flights
from .flights import Flights as Flights
from .flights import final_flight as final_flight
from .flights import flight_height as flight_height
from .flights import restitution as restitution
from .track import in_flight as in_flight
from .track import track_flights as track_flights
