"""Raw fill rate: how fast OpenGL covers an image with one colour, which no frame can beat."""

from time import process_time

from uavbench.scenes.rendering.context import functions
from uavbench.scenes.rendering.gpu import Program, Target

COVERS = 20
"""Times that an image is covered between two looks at the clock."""
ROUNDS = 5
VERTEX = """#version 330 core
void main() {
    gl_Position = vec4(vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) * 2.0 - 1.0, 0.5, 1.0);
}
"""
FRAGMENT = """#version 330 core
layout(location = 0) out vec4 colour;
layout(location = 1) out vec2 numbers;
void main() {
    colour = vec4(0.5);
    numbers = vec2(0.5);
}
"""


def fill_s(width: int, height: int) -> float:
    """Least processor time in s in which one triangle covers every pixel of a frame's target once, depth and all."""
    GL = functions()
    target, program, vertices = (
        Target(GL, width, height, numbered=True),
        Program(GL, VERTEX, FRAGMENT),
        GL.glGenVertexArrays(1),
    )
    GL.glViewport(0, 0, width, height)
    GL.glDisable(GL.GL_CULL_FACE)
    GL.glEnable(GL.GL_DEPTH_TEST)
    GL.glDepthFunc(GL.GL_ALWAYS)
    program.use()
    GL.glBindVertexArray(vertices)
    times = []
    for _ in range(ROUNDS + 1):
        begin = process_time()
        for _ in range(COVERS):
            GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
            GL.glFinish()
        times.append((process_time() - begin) / COVERS)
    GL.glDeleteVertexArrays(1, [vertices])
    GL.glDeleteProgram(program.id)
    target.delete()
    return min(times[1:])
