import stepbus_schemas


def test_every_message_fits_a_map_header_of_one_byte():
    # Encoders write up to 15 fields with a header of one byte; more would change the bytes.
    counts = {
        name: len(kind.__struct_fields__) for name, kind in stepbus_schemas.MESSAGE_TYPES.items()
    }
    assert {name: count for name, count in counts.items() if count > 15} == {}
