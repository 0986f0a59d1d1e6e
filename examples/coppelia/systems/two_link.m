% A torque controller of a two-link arm, over the legacy remote API (V-REP, `simx...`), in Octave.
% The same law as two_link.py: see there.
%
%   OCTAVE_PATH=<folder of remApi.oct> stepbus coppelia two_link/velocity_force -- \
%       octave-cli examples/coppelia/systems/two_link.m
%
% Add `60 0.02 2` for a PID with these gains instead of PD. Needs V-REP's client for Octave: remApi.oct and remApiSetup.m.
1;

function apply(vrep, client, joint, torque)   % emulate a torque [N*m]
  velocity = 9999 * direction(torque);
  simxSetJointTargetVelocity(client, joint, velocity, vrep.simx_opmode_oneshot);
  simxSetJointForce(client, joint, abs(torque), vrep.simx_opmode_oneshot);
end

function s = direction(x)
  s = 1 - 2 * (x < 0);
end

here = cd(fileparts(file_in_loadpath('remApi.oct')));   % remApiSetup looks for it there only
vrep = remApiSetup(); cd(here);
duration = 10; limit = 50; gains = {200, 0, 10};       % s, N*m
if numel(argv()) >= 3, gains = num2cell(cellfun(@str2double, argv()(end-2:end))); end
[kp, ki, kd] = gains{:};

client = -1;
for attempt = 1:20                                      % V-REP may start later than this script
  client = simxStart('127.0.0.1', 19997, true, true, 2000, 1);
  if client >= 0, break; end
  disp('waiting for V-REP on port 19997'); pause(0.5);
end
if client < 0, error('V-REP does not listen on port 19997'); end

joints = [0 0];
for i = 1:2
  [~, joints(i)] = simxGetObjectHandle(client, sprintf('joint%d', i), vrep.simx_opmode_blocking);
end
simxSynchronous(client, true);
simxStartSimulation(client, vrep.simx_opmode_blocking);
for joint = joints, simxGetJointPosition(client, joint, vrep.simx_opmode_streaming); end
simxGetPingTime(client);                                % the first angles have arrived

t = 0; before = []; integral = [0 0]; errors = [];
while t < duration
  q = [0 0];
  for i = 1:2, [~, q(i)] = simxGetJointPosition(client, joints(i), vrep.simx_opmode_buffer); end
  v = [0 0];
  if ~isempty(before) && t > before(1), v = (q - before(2:3)) / (t - before(1)); end
  before = [t q];
  e = [sin(t) cos(t)] - q;
  torque = kp * e + integral + kd * ([cos(t) -sin(t)] - v);
  grows = abs(torque) < limit | torque .* e < 0;
  integral = integral + grows .* (ki * e * 0.005);
  torque = max(-limit, min(limit, torque));
  simxPauseCommunication(client, true);                 % both torques in one message
  for i = 1:2, apply(vrep, client, joints(i), torque(i)); end
  simxPauseCommunication(client, false);
  if t >= 2, errors(end + 1, :) = e; end
  simxSynchronousTrigger(client);
  simxGetPingTime(client);                              % the step is done, and its angles are here
  [~, state] = simxGetInMessageInfo(client, vrep.simx_headeroffset_server_state);
  if ~bitand(state, 1), break; end                      % stopped, or the connection is gone
  t = simxGetLastCmdTime(client) / 1000;
end

printf('error from 2 s to %g s: RMS %.5f and %.5f rad, ', t, sqrt(mean(errors .^ 2, 1)));
printf('largest %.5f and %.5f rad\n', max(abs(errors), [], 1));
simxStopSimulation(client, vrep.simx_opmode_blocking);
simxFinish(client);
