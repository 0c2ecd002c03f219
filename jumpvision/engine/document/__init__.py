"""What a questioning says: its values as diagnosis.json has them, and the record that holds them."""

FILE = "diagnosis.json"
