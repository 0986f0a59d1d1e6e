% PD controller of a two-link arm: tau = kp (q_d - q) + kd (v_d - v).
%
% stepbus starts this script, writes numbers to /dev/fd/3 and reads the answer from /dev/fd/4;
% every number is a little-endian double. Inputs come in the order of scenario.yaml.

from_bus = fopen('/dev/fd/3', 'r', 'ieee-le');
to_bus = fopen('/dev/fd/4', 'w', 'ieee-le');
if from_bus < 0 || to_bus < 0
  error('descriptors 3 and 4 are not open: start this with `stepbus run .`');
end

% fwrite of Octave keeps what it gets until fflush. MATLAB's writes at once and has no fflush.
is_octave = exist('OCTAVE_VERSION', 'builtin') ~= 0;
if is_octave                                    % leave no file behind if the run is killed
  sigterm_dumps_octave_core(false);
  sighup_dumps_octave_core(false);
end

% Load your model here: the run starts when this 1 is written.
fwrite(to_bus, 1, 'double');
if is_octave
  fflush(to_bus);
end

% The header: settings of the scenario.
header = fread(from_bus, 8, 'double');
if numel(header) < 8
  exit(0);                                      % the run ended before it started
end
dt = header(2);                                 % length of a step [s]
n_in = header(5);                               % numbers received at each step ...
n_out = header(6);                              % ... and numbers to return
params = fread(from_bus, header(8), 'double');
kp = params(1);                                 % N·m/rad
kd = params(2);                                 % N·m·s/rad
n = n_out - 1;                                  % joints; the command has its mode in front
if n_in ~= 2 + 2 * (1 + 3 * n)
  error('%d numbers for %d joints: the inputs are joint_state and reference of all', n_in, n);
end

% Index of the fields: step, t, then for each input: present (0 or 1) and its fields.
joint_state = 3;                                % position, velocity, effort
reference = joint_state + 1 + 3 * n;            % position, velocity, acceleration
field = @(input, k) input + 1 + (k - 1) * n + (0:n - 1);
at_q = field(joint_state, 1);
at_v = field(joint_state, 2);
at_qd = field(reference, 1);
at_vd = field(reference, 2);
TORQUE = 0;                                     % mode; 1 velocity, 2 position, 3 teleport

fprintf('%d joints, kp %g, kd %g, a step of %g s\n', n, kp, kd, dt);   % to logs/controller.log

while true
  in = fread(from_bus, n_in, 'double');
  if numel(in) < n_in                           % end of file: the run is over
    break
  end
  t = in(2);                                    % simulation time [s], if your law needs it
  if in(joint_state) && in(reference)
    tau = kp * (in(at_qd) - in(at_q)) + kd * (in(at_vd) - in(at_v));
  else
    tau = zeros(n, 1);                          % an input has no message yet
  end
  fwrite(to_bus, [TORQUE; tau], 'double');
  if is_octave
    fflush(to_bus);
  end
end
