import java.io.*;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.*;

import static java.nio.charset.StandardCharsets.UTF_8;

/** A PD controller of a two-link arm: torque = kp (q_d - q) + kd (v_d - v), cut at its limits. */
public class Controller {
    private final double kp, kd;
    private int[] atReference;             // index of each joint in reference
    private double[] limit;                // N·m

    Controller(Map<?, ?> params) {
        kp = ((Number) params.get("kp")).doubleValue();    // N·m/rad
        kd = ((Number) params.get("kd")).doubleValue();    // N·m·s/rad
    }

    /** Takes the descriptions of the inputs. */
    void start(Map<?, ?> inputs) {
        Map<?, ?> state = (Map<?, ?>) inputs.get("joint_state");
        List<?> names = (List<?>) state.get("names");
        List<?> others = (List<?>) ((Map<?, ?>) inputs.get("reference")).get("names");
        if (!others.containsAll(names))
            throw new IllegalStateException("the reference " + others + " lacks one of " + names);
        atReference = names.stream().mapToInt(others::indexOf).toArray();
        limit = new double[names.size()];
        Arrays.fill(limit, Double.POSITIVE_INFINITY);
        if (state.get("limits") instanceof Map<?, ?> limits && limits.get("effort") != null)
            limit = vector(limits, "effort");
    }

    /** Returns the outputs of a step. */
    Map<String, ?> update(Map<?, ?> inputs) {
        Map<?, ?> state = (Map<?, ?>) inputs.get("joint_state");
        Map<?, ?> reference = (Map<?, ?>) inputs.get("reference");
        if (state == null || reference == null)
            return Map.of();               // not published yet: no command in this step
        double[] q = vector(state, "position"), v = vector(state, "velocity");
        double[] qd = vector(reference, "position"), vd = vector(reference, "velocity");
        List<Double> torque = new ArrayList<>();
        for (int i = 0; i < q.length; i++) {
            int k = atReference[i];
            double wanted = kp * (qd[k] - q[i]) + kd * (vd[k] - v[i]);
            torque.add(Math.min(Math.max(wanted, -limit[i]), limit[i]));
        }
        return Map.of("command", Map.of("mode", "torque", "values", torque));
    }

    static double[] vector(Map<?, ?> message, String field) {
        List<?> numbers = (List<?>) message.get(field);
        return numbers.stream().mapToDouble(x -> ((Number) x).doubleValue()).toArray();
    }

    /** Reads from descriptor 3 and answers on descriptor 4 until the bridge closes the former. */
    public static void main(String[] args) throws IOException {
        var in = new DataInputStream(new BufferedInputStream(new FileInputStream("/dev/fd/3")));
        var out = new FileOutputStream("/dev/fd/4");
        Controller controller = null;
        while (true) {
            try {
                in.readInt();              // length of the message; MessagePack knows its own end
            } catch (EOFException end) {
                return;
            }
            Map<?, ?> message = (Map<?, ?>) MessagePack.read(in);
            if (message.get("welcome") instanceof Map<?, ?> welcome) {
                controller = new Controller((Map<?, ?>) welcome.get("params"));
                send(out, Map.of("ready", Map.of()));
            } else if (message.get("start") instanceof Map<?, ?> start) {
                controller.start((Map<?, ?>) start.get("inputs"));
            } else if (message.get("update") instanceof Map<?, ?> update) {
                send(out, Map.of("outputs", controller.update((Map<?, ?>) update.get("inputs"))));
            }
        }
    }

    static void send(OutputStream out, Map<String, ?> message) throws IOException {
        byte[] body = MessagePack.pack(message);
        ByteBuffer frame = ByteBuffer.allocate(4 + body.length).order(ByteOrder.LITTLE_ENDIAN);
        out.write(frame.putInt(body.length).put(body).array());
    }
}

/** As much of MessagePack as the messages need: https://github.com/msgpack/msgpack. */
class MessagePack {
    static Object read(DataInputStream in) throws IOException {
        int head = in.readUnsignedByte();
        if (head < 0x80 || head >= 0xe0) return (long) (byte) head;
        if (head < 0x90) return map(in, head & 15);
        if (head < 0xa0) return list(in, head & 15);
        if (head < 0xc0) return text(in, head & 31);
        return switch (head) {
            case 0xc0 -> null;
            case 0xc2, 0xc3 -> head == 0xc3;
            case 0xca -> (double) in.readFloat();
            case 0xcb -> in.readDouble();
            case 0xcc -> (long) in.readUnsignedByte();
            case 0xcd -> (long) in.readUnsignedShort();
            case 0xce -> in.readInt() & 0xffffffffL;
            case 0xcf, 0xd3 -> in.readLong();
            case 0xd0 -> (long) in.readByte();
            case 0xd1 -> (long) in.readShort();
            case 0xd2 -> (long) in.readInt();
            case 0xd9 -> text(in, in.readUnsignedByte());
            case 0xda -> text(in, in.readUnsignedShort());
            case 0xdb -> text(in, in.readInt());
            case 0xdc -> list(in, in.readUnsignedShort());
            case 0xdd -> list(in, in.readInt());
            case 0xde -> map(in, in.readUnsignedShort());
            case 0xdf -> map(in, in.readInt());
            default -> throw new IOException("MessagePack: unexpected byte " + head);
        };
    }

    private static String text(DataInputStream in, int length) throws IOException {
        return new String(in.readNBytes(length), UTF_8);
    }

    private static List<Object> list(DataInputStream in, int count) throws IOException {
        List<Object> items = new ArrayList<>();
        while (items.size() < count) items.add(read(in));
        return items;
    }

    private static Map<Object, Object> map(DataInputStream in, int count) throws IOException {
        Map<Object, Object> entries = new HashMap<>();
        for (int i = 0; i < count; i++) entries.put(read(in), read(in));
        return entries;
    }

    static byte[] pack(Object value) throws IOException {
        var bytes = new ByteArrayOutputStream();
        write(new DataOutputStream(bytes), value);
        return bytes.toByteArray();
    }

    private static void write(DataOutputStream out, Object value) throws IOException {
        if (value instanceof Map<?, ?> map) {
            out.writeByte(0xde);
            out.writeShort(map.size());
            // Sorted: the order of Map.of changes between runs, but equal runs need equal bytes.
            for (var entry : new TreeMap<Object, Object>(map).entrySet()) {
                write(out, entry.getKey());
                write(out, entry.getValue());
            }
        } else if (value instanceof List<?> list) {
            out.writeByte(0xdc);
            out.writeShort(list.size());
            for (Object item : list) write(out, item);
        } else if (value instanceof Double number) {
            out.writeByte(0xcb);
            out.writeDouble(number);
        } else {
            byte[] text = ((String) value).getBytes(UTF_8);
            out.writeByte(0xda);
            out.writeShort(text.length);
            out.write(text);
        }
    }
}
